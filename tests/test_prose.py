"""Pages are plain English: short sentences, few numbers, the field's words, short pages."""

import re

import pytest
from support.paths import REPOSITORY

RESULTS = REPOSITORY / "experiments" / "results"
PAGES = sorted(
    [REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md"]
    + [*(REPOSITORY / "docs").rglob("*.md"), *RESULTS.rglob("*.md")]
)
SETTINGS = sorted(
    [*(REPOSITORY / "configs").glob("*.yaml"), *(REPOSITORY / "experiments").rglob("*.yaml")]
)
MOST_WORDS = 35
MOST_NUMBERS = 2
MOST_RESULTS = 14
# The most lines of a page, by its path.
MOST_LINES = {"README.md": 100} | {
    f"{p.relative_to(REPOSITORY)}": 60 for p in RESULTS.rglob("*.md")
}
# Words of ours, and the field's.
WORDS = {
    r"films?|filmed|filming": "video, record",
    r"pays?|paid|earns?|earned|worth|owed|wages?": "reward, return, value",
    r"moments?": "state",
    r"landings?|staircases?": "stage floor",
    r"ascents?": "adversarial steps",
    r"outbids?": "misranked successes",
    r"held noise": "correlated noise",
    r"mending|mended|mends": "smoothing, repair",
    r"solves?|solved": "succeed",
    r"drawn|draws": "sampled",
    r"older": "give figures of current code alone",
    r"sound": "passes the audit",
    r"lanes?|cards?": "environments, GPUs",
}


def prose(text: str) -> list[tuple[int, str]]:
    """The sentences of a page outside code, tables and quotes, each with the line it begins on.

    Full stops, colons, question marks and the ends of paragraphs, headings and list items end a
    sentence. Code in a line counts as one word without numbers; of a link its text counts.
    """
    text = re.sub(r"\A---\n.*?^---\n", _blank, text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^( *)(`{3,}).*?^ *\2", _blank, text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"<!--.*?-->", _blank, text, flags=re.DOTALL)
    text = re.sub(r"`[^`\n]*`", "code", text)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"<[^>\n]*>|https?://\S+", "", text)
    text = re.sub(r"\d{4}-\d\d-\d\d|\b\d+:\d\d\b", "then", text)  # a date or a time is a word
    found, words, begun = [], [], 1

    def end() -> None:
        if words:
            found.append((begun, " ".join(words)))
            words.clear()

    for number, line in enumerate(text.split("\n"), 1):
        bare = line.strip()
        if not bare or bare.startswith(("|", ">", "#", ":::")):
            end()
            continue
        if re.match(r"([-*+]|\d+\.)\s", bare):
            end()
            bare = re.sub(r"^([-*+]|\d+\.)\s+", "", bare)
        for word in bare.strip("*_ ").split():
            if not words:
                begun = number
            words.append(word)
            ends = re.search(r"[.:?!][)\"'*_]*$", word)
            if ends and not re.fullmatch(r"(e\.g|i\.e|cf|vs|Eqs?|Fig|No|et al|al)\.", word):
                end()
    end()
    return found


def _blank(found: re.Match) -> str:
    return "\n" * found[0].count("\n")


def faults(text: str) -> list[str]:
    """What a page says at too great length, in too many numbers or in words of ours."""
    said = []
    for line, sentence in prose(text):
        words = [w for w in sentence.split() if re.search(r"\w", w)]
        numbers = re.findall(r"(?<![\w.])[+-]?\d+(?:[.,]\d+)*(?![\w])", sentence)
        start = " ".join(words[:6])
        if len(words) > MOST_WORDS:
            said.append(f"{line}: {len(words)} words: {start} ...")
        if len(numbers) > MOST_NUMBERS:
            said.append(f"{line}: {len(numbers)} numbers: {start} ...")
        for ours, theirs in WORDS.items():
            if found := re.search(rf"\b({ours})\b", sentence, re.IGNORECASE):
                said.append(f"{line}: {found[0]!r}, say {theirs}: {start} ...")
    return said


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(REPOSITORY).as_posix())
def test_a_page_is_plain_english(path):
    name, text = path.relative_to(REPOSITORY).as_posix(), path.read_text()
    said = [f"{name}:{fault}" for fault in faults(text)]
    length, most = len(text.splitlines()), MOST_LINES.get(name)
    if most is not None and length > most:
        said.append(f"{name}: {length} lines, {most} at most")
    assert not said, "\n".join(said)


@pytest.mark.parametrize("path", SETTINGS, ids=lambda path: path.stem)
def test_comments_of_settings_use_the_words_of_the_field(path):
    comments = re.findall(r"(?:^|\s)# ?(.*)", path.read_text())
    said = [fault for fault in faults("\n\n".join(comments)) if "say" in fault]
    assert not said, "\n".join(said)


def test_there_are_few_pages_of_results():
    pages = [path for path in RESULTS.rglob("*.md") if path.parent != RESULTS]
    assert len(pages) <= MOST_RESULTS


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("word " * 36 + ".", "36 words"),
        ("It takes 2 to 3 minutes, or 4.", "3 numbers"),
        ("Its film is short.", "'film'"),
        ("Success is\npaid here.", "'paid'"),
    ],
)
def test_a_fault_is_found(text, fault):
    (said,) = faults(text)
    assert fault in said


@pytest.mark.parametrize(
    "text",
    [
        "Short: " + "word " * 30 + ".",
        "| 1 | 2 | 3 | videos |",
        "```\nfilms 1 2 3\n```",
        "`policy.film(1, 2, 3)` writes a video.",
        "- one two\n- three four",
    ],
)
def test_code_tables_and_lists_are_no_long_sentences(text):
    assert not faults(text)
