"""Sub-models: which sections are cut out, with what margins, and that the cut keeps the vessel's shape."""

from __future__ import annotations

from pathlib import Path

import pytest

from granpipe.case.reader import load_case, varied
from granpipe.case.schema import Case
from granpipe.geometry.outline import Outline
from granpipe.planning.make import make_plan
from granpipe.planning.submodel import Span, spans, sub_case

REACTOR = Path(__file__).parents[2] / "cases" / "reactor.yaml"


@pytest.fixture(scope="module")
def reactor() -> Case:
    return load_case(REACTOR)


def reactor_spans(case: Case, *need: str, d90: float = 0.1) -> tuple[Span, ...]:
    outline = Outline.from_case(case)
    needs = {name: "needed" if name in need else "" for name in case.outline.sections}
    return spans(case, needs, d90, lambda z, side: float(outline.hydraulic_diameter(z, side)))


def test_neighbouring_sections_make_one_span_with_a_margin_at_its_seam(reactor: Case) -> None:
    (span,) = reactor_spans(reactor, "d", "e", "f")
    assert span.sections == ("d", "e", "f")
    assert (span.top, span.bottom) == (3.4, 0)
    assert span.cut_top == pytest.approx(3.4 + 0.5)  # half of the throat's 1 m, and five times 0.1 m
    assert span.cut_bottom == 0  # the vessel's own outlet


def test_large_particles_want_a_larger_margin(reactor: Case) -> None:
    (span,) = reactor_spans(reactor, "d", "e", "f", d90=0.2)
    assert span.cut_top == pytest.approx(3.4 + 1.0)


def test_spans_whose_margins_meet_become_one(reactor: Case) -> None:
    (span,) = reactor_spans(reactor, "b", "d")
    assert span.sections == ("b", "c", "d")


def test_spans_far_apart_stay_two(reactor: Case) -> None:
    first, second = reactor_spans(reactor, "a", "f", d90=0.05)
    assert (first.sections, second.sections) == (("a",), ("f",))
    assert first.cut_bottom > second.cut_top


def test_the_cut_keeps_shape_obstacles_and_levels(reactor: Case) -> None:
    (span,) = reactor_spans(reactor, "d", "e", "f")
    part = sub_case(reactor, span)
    whole, cut = Outline.from_case(reactor), Outline.from_case(part)
    assert part.name == "reactor-d_f"
    assert (cut.z_top, cut.z_bottom) == (pytest.approx(3.9), 0)
    for z in (3.89, 3.5, 3.39, 2.0, 1.0, 0.01):
        assert cut.area(z) == pytest.approx(whole.area(z))
    assert list(part.outline.sections) == ["c", "d", "e", "f"]
    assert list(part.outline.obstacles) == ["ring"]


def test_a_sub_model_is_planned_like_any_case_and_costs_less(reactor: Case) -> None:
    (span,) = reactor_spans(reactor, "d", "e", "f")
    whole, part = make_plan(reactor), make_plan(sub_case(reactor, span))
    assert part.dem.particles < 0.8 * whole.dem.particles
    assert part.particle_steps < whole.particle_steps


def test_a_sub_model_can_be_varied_as_replicas_and_the_pilot_do(reactor: Case) -> None:
    (span,) = reactor_spans(reactor, "d", "e", "f")
    part = varied(sub_case(reactor, span), {"dem.seed": "7"})
    assert part.dem.seed == 7
    assert part.outline.levels == sub_case(reactor, span).outline.levels
