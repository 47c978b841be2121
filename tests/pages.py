"""The pages of the project: README.md of the top and of the folders. Their blocks, links, headings and sentences.

A comment before a fenced block says what the tests do with it besides:

    <!-- file: NAME -->         they also write it under this name into the folder where the page's blocks run
    <!-- not run: REASON -->    they do not run it, but look whether its commands, options and files exist"""

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("src", "plugins", "tests", "scenes")
LANGUAGES = ("python", "sh", "toml", "text", "mermaid", "yaml")

_FENCE = re.compile(r"^((?:<!--[^\n]*-->\n)*)```([^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_NOTE = re.compile(r"<!-- (file|not run): (.+?) -->")
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, the name that it is written to, and why it is not run."""

    language: str
    text: str
    file: str = ""
    not_run: str = ""


class Page:
    """A page; `prose` is its text without fenced blocks and comments, `inline` the pieces of code in it."""

    def __init__(self, path: Path):
        self.path, self.name, self.text = path, path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        self.prose = re.sub(r"<!--.*?-->", "", _FENCE.sub("", self.text), flags=re.DOTALL)
        links = _LINK.findall(self.prose)
        self.links = [target for _, _, target in links]
        self.pictures = [target for mark, _, target in links if mark]
        self.inline = re.findall(r"(?<!`)`([^`\n]+)`(?!`)", self.prose)

    @cached_property
    def blocks(self) -> list[Block]:
        found = [(language, text, dict(_NOTE.findall(notes))) for notes, language, text in _FENCE.findall(self.text)]
        return [Block(language, text, notes.get("file", ""), notes.get("not run", "")) for language, text, notes in found]

    @property
    def anchors(self) -> set[str]:
        found: list[str] = []
        for heading in re.findall(r"^#+ (.+)$", self.prose, re.MULTILINE):
            plain = _LINK.sub(r"\2", heading).replace("`", "").strip().lower()
            slug = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
            before = found.count(slug)
            found.append(slug)
            if before:
                found.append(f"{slug}-{before}")
        return set(found)

    @property
    def sentences(self) -> list[str]:
        """Sentences of the prose: those of paragraphs, of items of lists, and of the cells of tables, without markup."""
        plain = _LINK.sub(lambda link: "" if link[1] else link[2], self.prose)
        pieces = re.split(r"\n\s*\n|\n(?=\s*(?:[-*#|]|\d+\.) ?)|(?<!\\)\|", plain)
        texts = (" ".join(piece.split()) for piece in pieces)
        return [sentence for text in texts for sentence in re.split(r"(?<=[.!?:;]) (?=\S)", text) if sentence]


def pages() -> list[Path]:
    return [ROOT / "README.md", *sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.md"))]
