"""Puts the site's pages into one folder: `python docs/stage.py FOLDER`.

The front page is README.md. The pages of docs/, the results with their own READMEs, the changelog
and CONTRIBUTING lie in different folders of the repository, where a reader of the sources finds
them, and in one folder on the site. Links between them are those of the repository and are changed
here. A link to a file of the repository that is not on the site becomes its text.
"""

import base64
import json
import os
import re
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# A file or folder of the repository, and where it lies on the site.
PLACES = {
    "README.md": "index.md",
    "docs": "",
    "experiments/results": "results",
    "CHANGELOG.md": "CHANGELOG.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "CITATION.cff": "CITATION.cff",
}
_LINK = re.compile(r"\[([^\]]*)\]\(([^)#\s:]+)(#[^)\s]*)?\)")  # [text](path#anchor), no address


def main(folder: Path) -> None:
    """Writes the pages of the site into a folder, which is emptied first."""
    shutil.rmtree(folder, ignore_errors=True)
    for source, place in PLACES.items():
        if (ROOT / source).is_dir():
            ignored = shutil.ignore_patterns("*.py", "__pycache__")
            shutil.copytree(ROOT / source, folder / place, dirs_exist_ok=True, ignore=ignored)
        else:
            folder.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / source, folder / place)
    for path in folder.rglob("*.ipynb"):
        path.with_suffix(".md").write_text(_page(path))
    for path in sorted(folder.rglob("*.md")):
        here = path.relative_to(folder)
        path.write_text(_LINK.sub(lambda found, here=here: _moved(here, found), path.read_text()))


def _page(notebook: Path) -> str:
    """A notebook as a page, with its figures beside it."""
    parts = [f"[This page as a notebook]({notebook.name})"]
    for number, cell in enumerate(json.loads(notebook.read_text())["cells"]):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.insert(0 if number == 0 else len(parts), source)
            continue
        parts.append(f"```python\n{source}\n```")
        for place, output in enumerate(cell["outputs"]):
            data = output.get("data", {})
            if "image/png" in data:
                picture = notebook.with_name(f"{notebook.stem}_{number}_{place}.png")
                picture.write_bytes(base64.b64decode(data["image/png"]))
                parts.append(f"![Output of the cell above]({picture.name})")
            elif text := "".join(output.get("text", data.get("text/plain", ""))).rstrip():
                parts.append(f"```text\n{text}\n```")
    return "\n\n".join(parts) + "\n"


def _moved(here: Path, found: re.Match) -> str:
    """One link of the page `here` of the site, as it has to be there."""
    words, target, anchor = found.groups()
    if (ROOT / _source(here).with_suffix(".ipynb")).exists():  # its figures are the site's alone
        return found[0]
    place = _on_site(Path(os.path.normpath(_source(here).parent / target)))
    if place is None:
        return words
    return f"[{words}]({os.path.relpath(place, here.parent)}{anchor or ''})"


def _source(page: Path) -> Path:
    """The file of the repository that a page of the site is made from."""
    for source, place in PLACES.items():
        if place and page.is_relative_to(place):
            return Path(source, page.relative_to(place))
    return Path("docs", page)


def _on_site(source: Path) -> Path | None:
    """The place of a repository file on the site; None if it is not part of it.

    Raises:
      ValueError: there is no such file.
    """
    for name, place in PLACES.items():
        if source.is_relative_to(name):
            on_site = Path(place, source.relative_to(name))
            return on_site.with_suffix(".md") if on_site.suffix == ".ipynb" else on_site
    if not (ROOT / source).exists():
        raise ValueError(f"a page links to {source}, which does not exist")
    return None


if __name__ == "__main__":
    main(Path(sys.argv[1]))
