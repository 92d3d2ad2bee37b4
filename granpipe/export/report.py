"""A self-contained HTML page of text, tables and pictures, for a run and for a study."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from granpipe.system.templates import templates

Standing = Literal["good", "marked", "failed"]


class Link(NamedTuple):
    """A cell of a table that leads to a file beside the page."""

    text: str
    href: str


class Number(NamedTuple):
    """A key number of the first screen: what it is, its value with unit, and what to know beside it."""

    name: str
    value: str
    note: str = ""


@dataclass(frozen=True)
class Verdict:
    """Whether the result may be used, in one sentence."""

    standing: Standing
    text: str


@dataclass(frozen=True)
class Picture:
    """A PNG file of the page.

    Parameters
    ----------
    caption : what it shows, and how to read it
    alt : what it shows, for those who do not see it; the caption unless given
    """

    path: Path
    caption: str = ""
    alt: str = ""


@dataclass(frozen=True)
class Section:
    """A part of the page: text, pictures, a list, a table.

    Parameters
    ----------
    title : its heading
    text : paragraphs
    figures : PNG files, with or without a caption
    head, rows : a table; none without rows
    items : a list
    numbered : whether the items are steps
    narrow : whether the pictures stand side by side
    """

    title: str
    text: Sequence[str] = ()
    figures: Sequence[Path | Picture] = ()
    head: Sequence[str] = ()
    rows: Sequence[Sequence[str | Link]] = ()
    items: Sequence[str] = ()
    numbered: bool = False
    narrow: bool = False


def write_page(
    path: Path,
    title: str,
    intro: Sequence[str],
    sections: Sequence[Section],
    verdict: Verdict | None = None,
    numbers: Sequence[Number] = (),
) -> None:
    """Write the page; pictures go into it, so that it can be sent as one file and read without a network."""
    parts = [
        {
            "section": section,
            "anchor": f"part-{number}-{re.sub('[^a-z0-9]+', '-', section.title.lower()).strip('-')}",
            "figures": [_embedded(figure, section.title) for figure in section.figures],
        }
        for number, section in enumerate(sections, start=1)
    ]
    page = templates(html=True).get_template("report.html.j2")
    text = page.render(title=title, intro=intro, parts=parts, verdict=verdict, numbers=numbers)
    path.write_text(text, encoding="utf-8")


def _embedded(figure: Path | Picture, title: str) -> dict[str, str | int]:
    picture = figure if isinstance(figure, Picture) else Picture(figure)
    content = picture.path.read_bytes()
    width, height = int.from_bytes(content[16:20]), int.from_bytes(content[20:24])  # where every PNG file has them
    return {
        "caption": picture.caption,
        "alt": picture.alt or picture.caption or title,
        "data": base64.b64encode(content).decode(),
        "width": width,
        "height": height,
    }


def markdown(sections: Sequence[Section]) -> str:
    """The same text and tables as Markdown, without pictures."""
    lines: list[str] = []
    for section in sections:
        lines += [f"## {section.title}", ""]
        for paragraph in section.text:
            lines += [paragraph, ""]
        if section.rows:
            lines += ["| " + " | ".join(section.head) + " |", "|" + "---|" * len(section.head)]
            lines += ["| " + " | ".join(map(_plain, row)) + " |" for row in section.rows]
            lines.append("")
    return "\n".join(lines)


def _plain(cell: str | Link) -> str:
    return cell if isinstance(cell, str) else f"[{cell.text}]({cell.href})"
