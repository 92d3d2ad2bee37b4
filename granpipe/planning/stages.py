"""Stages of a DEM run that depend on its settings, and what its decks leave out."""

from __future__ import annotations

from granpipe.case.schema import Case
from granpipe.dem.packing import WIDEST, packable
from granpipe.dem.settings import Settings
from granpipe.planning.plan import Stage


def settle_stage(settings: Settings) -> Stage:
    if settings.fall_steps:
        return Stage("settle", "a packed bed falls into place; it is topped up then and in the faster start")
    if packable(settings.classes):
        return Stage("settle", "a packed bed, topped up until the vessel is full, comes to rest")
    return Stage("settle", f"particles drop in until the vessel is full and at rest: sizes over {WIDEST:g} : 1")


def left_out_of_decks(case: Case) -> list[Stage]:
    contact, left = case.contact, []
    if contact.rolling_model == "none" or max(contact.rolling_friction, contact.wall.rolling_friction) == 0:
        left.append(Stage("rolling model", "no rolling friction"))
    if max(contact.friction, contact.wall.friction) == 0:
        left.append(Stage("tangential history", "no friction"))
    if case.material.size.kind == "mono":
        left.append(Stage("size classes", "one size"))
    if case.dem.outlet == "open":
        left.append(Stage("moving plate", "the outlet is open"))
    if not case.outline.obstacles:
        left.append(Stage("obstacle meshes", "no obstacles"))
    return left
