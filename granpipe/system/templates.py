"""The templates of granpipe: decks, scripts and pages that read like the thing they make."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment


@cache
def templates(*, html: bool = False, trim_blocks: bool = True, keep_trailing_newline: bool = False) -> Environment:
    """The templates, strict about names; kept, for compiling one takes longer than filling it in.

    Parameters
    ----------
    html : values are escaped for a page
    trim_blocks, keep_trailing_newline : as Jinja has them
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("granpipe"),
        undefined=StrictUndefined,
        autoescape=html,
        trim_blocks=trim_blocks,
        lstrip_blocks=html,
        keep_trailing_newline=keep_trailing_newline,
    )
