"""Puts the site's pages into one folder: `python docs/stage.py FOLDER`.

The pages of docs/, the results with their own READMEs, the changelog and CONTRIBUTING lie in
different folders of the repository, where a reader of the sources finds them, and in one folder on
the site. Links between them are those of the repository and are changed here.
"""

import os
import re
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# A file or folder of the repository, and where it lies on the site.
PLACES = {
    "docs": "",
    "experiments/results": "results",
    "CHANGELOG.md": "CHANGELOG.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
}
_LINK = re.compile(r"(\]\()([^)#\s:]+)(#[^)\s]*)?(\))")  # [text](path#anchor), no address


def main(folder: Path) -> None:
    """Writes the pages of the site into a folder, which is emptied first."""
    shutil.rmtree(folder, ignore_errors=True)
    for source, place in PLACES.items():
        if (ROOT / source).is_dir():
            ignored = shutil.ignore_patterns("*.py", "__pycache__")
            shutil.copytree(ROOT / source, folder / place, dirs_exist_ok=True, ignore=ignored)
        else:
            shutil.copyfile(ROOT / source, folder / place)
    for path in sorted(folder.rglob("*.md")):
        here = path.relative_to(folder)
        path.write_text(_LINK.sub(lambda found, here=here: _moved(here, found), path.read_text()))


def _moved(here: Path, found: re.Match) -> str:
    """One link of the page `here` of the site, as it has to be there."""
    opened, target, anchor, closed = found.groups()
    aim = os.path.normpath(_source(here).parent / target)
    at = os.path.relpath(_on_site(Path(aim)), here.parent)
    return f"{opened}{at}{anchor or ''}{closed}"


def _source(page: Path) -> Path:
    """The file of the repository that a page of the site is made from."""
    for source, place in reversed(PLACES.items()):
        if page.is_relative_to(place):
            return Path(source, page.relative_to(place))
    raise AssertionError(page)


def _on_site(source: Path) -> Path:
    """The place of a repository file on the site.

    Raises:
      ValueError: it is not part of the site.
    """
    for name, place in PLACES.items():
        if source.is_relative_to(name):
            return Path(place, source.relative_to(name))
    raise ValueError(f"a page links to {source}, which is not on the site")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
