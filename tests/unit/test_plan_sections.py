"""Which sections may be a fluid: floors are funnels, openings pass so much, and a fluid knows what it weighs."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from fakes.small_vessels import FLAT, case_of, hopper, plan_of, said

from granpipe.case.reader import read_case
from granpipe.errors import CaseError
from granpipe.planning.make import make_plan, model_plans, other_rheology
from granpipe.planning.plan import Plan
from granpipe.planning.text import plan_text


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"dem.outlet": "open"},
        {"outline.sections": "{a: [110, 0], b: [0, -6]}"},
        {"outline.sections": "{a: [9, 8]}"},
    ],
    ids=str,
)
def test_a_flat_bottom_is_simulated(changes: dict[str, str]) -> None:
    plan = plan_of(FLAT, dem__max_time="100 s", **changes)
    assert plan.model == "dem"
    assert any("solids rest on the ledge at z = 0 m" in stage.reason for stage in plan.stages)


@pytest.mark.parametrize("level", [0.5, 3, 10, 20, 29])
def test_a_nearly_level_floor_is_a_funnel_even_where_the_case_calls_it_mass_flow(level: float) -> None:
    plan = plan_of(hopper(90 - level), dem__max_time="100 s", **said(90 - level))
    assert plan.model == "dem"
    for changes in ({"model": "fluid"}, {"model": "hybrid", "outline__sections__b__model": "fluid"}):
        with pytest.raises(CaseError, match="solids rest on the floor from z = "):
            plan_of(hopper(90 - level), **said(90 - level) | changes)


@pytest.mark.parametrize("half_angle", [10, 30, 59])
def test_a_hopper_that_the_case_calls_mass_flow_is_a_fluid(half_angle: float) -> None:
    plan = plan_of(hopper(half_angle), **said(half_angle))
    assert plan.model == "fluid"
    assert plan.breaches == ()


def test_a_flat_bottom_is_refused_as_a_fluid_at_its_place_in_the_file() -> None:
    with pytest.raises(CaseError, match="section s1 cannot be a fluid: solids rest on the ledge") as refusal:
        plan_of(FLAT, model="fluid")
    assert refusal.value.key == ("outline", "wall", 2)
    for model in ("fluid", "hybrid"):
        sections = "{a: {z: [110, 0], model: fluid}, b: {z: [0, -6], model: %s}}"
        with pytest.raises(CaseError, match="section a cannot be a fluid") as refusal:
            plan_of(FLAT, model=model, outline__sections=sections % ("dem" if model == "hybrid" else "fluid"))
        assert refusal.value.key == ("outline", "sections", "a", "model")


def test_a_ledge_at_the_inlet_or_at_the_outlet_is_seen() -> None:
    for wall in ("[[90, 110], [60, 110], [60, 0]]", "[[90, 110], [90, 0], [24, 0]]"):
        assert plan_of(wall, dem__max_time="100 s").model == "dem"
        with pytest.raises(CaseError, match="solids rest on the ledge"):
            plan_of(wall, model="fluid")


def test_a_section_more_than_a_diameter_above_a_floor_is_a_plug() -> None:
    tall = "[[90, 700], [90, 0], [24, 0], [24, -6]]"
    plan = plan_of(tall, model="hybrid", outline__sections="{a: [700, 180], b: [180, 0], c: [0, -6]}",
                   dem__max_time="100 s")  # fmt: skip
    assert [span.sections for span, _ in plan.submodels] == [("b", "c")]
    with pytest.raises(CaseError, match="section a cannot be a fluid"):
        plan_of(tall, model="fluid", outline__sections="{a: [700, 170], b: {z: [170, 0], model: fluid}, c: [0, -6]}")


def test_a_funnel_does_not_reach_through_a_throat_above_it() -> None:
    wall = "[[90, 400], [90, 300], [60, 220], [60, 150], [90, 150], [90, 0], [24, 0], [24, -6]]"
    sections = "{a: [400, 300], b: {z: [300, 220], regime: mass_flow}, c: [220, 150], d: [150, 0], e: [0, -6]}"
    plan = plan_of(wall, model="hybrid", outline__sections=sections, dem__max_time="100 s")
    assert [span.sections for span, _ in plan.submodels] == [("d", "e")]


UNCOVERED = "[[90, 400], [90, 300], [60, 220], [60, 150], [90, 150], [90, 0], [24, 0], [24, -6]]"


def test_a_shaft_that_no_section_covers_is_a_fluid_of_the_hybrid() -> None:
    sections = "{b: {z: [300, 220], regime: mass_flow}, c: [220, 150], d: [150, 0], e: [0, -6]}"
    plan = plan_of(UNCOVERED, model="hybrid", outline__sections=sections, dem__max_time="100 s")
    assert [factor.name for factor in plan.wall_factors] == ["wall factor of section b"]


def test_a_hopper_that_no_section_covers_is_no_fluid_of_the_hybrid() -> None:
    with pytest.raises(CaseError, match=r"the vessel between z = 0.4 and 0.22 m needs DEM"):
        plan_of(UNCOVERED, model="hybrid", outline__sections="{c: [220, 150], d: [150, 0], e: [0, -6]}")


def test_a_ledge_that_holds_no_particle_is_no_floor_but_a_staircase_of_such_ledges_is() -> None:
    assert plan_of("[[90, 110], [90, 50], [89.5, 50], [89.5, 0]]").model == "fluid"
    assert plan_of("[[90, 110], [90, 50], [88, 50], [88, 0]]", dem__max_time="100 s").model == "dem"
    steps = [(90 - 0.5 * i, 110 - 4 * (i + k)) for i in range(12) for k in (0, 1)]
    plan = plan_of(str([list(step) for step in steps]), dem__max_time="100 s")
    assert plan.model == "dem"


def test_a_dished_bottom_is_a_floor_where_it_is_nearly_level() -> None:
    arc = [(90 * math.cos(math.radians(a)), 100 - 90 * math.sin(math.radians(a))) for a in range(0, 76, 5)]
    wall = str([[90, 200], *(list(point) for point in arc)])
    plan = plan_of(wall, dem__max_time="100 s")
    assert plan.model == "dem"
    with pytest.raises(CaseError, match="solids rest on the floor"):
        plan_of(wall, model="fluid")


def test_the_pipe_above_a_funnel_flow_hopper_is_no_plug_near_it() -> None:
    sections = "{a: [200, 114], b: {z: [114, 0], regime: funnel_flow}, c: [0, -6]}"
    plan = plan_of("[[90, 200], [90, 114], [24, 0], [24, -6]]", outline__sections=sections, dem__max_time="100 s")
    assert plan.model == "dem"


def test_a_fluid_of_what_it_does_not_describe_is_marked_and_the_plan_says_one_thing_about_it() -> None:
    wall, ring = "[[90, 400], [90, 0]]", "{ring: [[60, 190], [90, 190], [90, 200], [60, 200]]}"
    case = case_of(wall, model="fluid", outline__obstacles=ring)
    plan = make_plan(case)
    assert any("obstacle ring stands in it" in breach for breach in plan.breaches)
    text = plan_text(plan, model_plans(case), other_rheology(case), None)
    assert "every section is straight" not in text
    assert "does not describe every section" in text
    fits = case_of(wall, model="fluid")
    assert make_plan(fits).breaches == ()
    text = plan_text(make_plan(fits), model_plans(fits), other_rheology(fits), None)
    assert "every section is straight" in text
    assert "does not describe" not in text
    assert "fluid, frictional" in text  # stands beside, with its error
    assert text.count("its error is not known: of its kind (pipe) 0 vessels") == 2


def test_a_heap_on_an_obstacle_belongs_to_the_section_above_it() -> None:
    ring = "{ring: [[60, 190], [90, 190], [90, 200], [60, 200]]}"
    sections = "{a: [400, 200], b: [200, 190], c: [190, 0]}"
    plan = plan_of("[[90, 400], [90, 0]]", outline__obstacles=ring, outline__sections=sections, dem__max_time="100 s")
    assert plan.model == "dem"


def test_a_widening_that_no_section_covers_is_seen() -> None:
    wall = "[[60, 400], [60, 200], [90, 200], [90, 0]]"
    sections = "{a: [400, 300], b: [100, 0]}"
    plan = plan_of(wall, outline__sections=sections, dem__max_time="100 s")
    assert plan.model == "dem"
    with pytest.raises(CaseError, match=r"between z = 0\.3 and 0\.1 m needs DEM .* but no section covers it"):
        plan_of(wall, model="hybrid", outline__sections=sections)


@pytest.mark.parametrize("rate", ["1 l/h", "1 kg/h"])
@pytest.mark.parametrize("model", ["fluid", "auto"])
def test_a_fluid_without_bulk_density_is_refused(model: str, rate: str) -> None:
    with pytest.raises(CaseError, match="missing; a fluid has no particles to measure the packing by") as refusal:
        plan_of("[[90, 400], [90, 0]]", bulk="internal_friction_angle: 35 deg", model=model, flow_rate=rate)
    assert refusal.value.key == ("material", "bulk_density")
    dem = {"model": "dem", "dem__max_time": "100 s"}
    assert plan_of("[[90, 400], [90, 0]]", bulk="internal_friction_angle: 35 deg", flow_rate=rate, **dem).runs


@pytest.mark.parametrize("name", ["reactor", "reactor_hybrid", "reactor_paper"])
def test_the_reactors_whose_bulk_density_is_not_known_are_no_fluids(name: str) -> None:
    """The article does not tell it; a hybrid measures the packing where it simulates particles."""
    path = Path(__file__).parents[2] / "cases" / f"{name}.yaml"
    with pytest.raises(CaseError, match="give the bulk density, or set model: dem"):
        make_plan(read_case(path, {"model": "fluid"}).case)
    assert make_plan(read_case(path, {"model": "hybrid"}).case).runs


def test_fields_that_only_particles_tell_are_told_to_be_left_out() -> None:
    fields = {"homogenize__fields": "[stress, strain_rate, coordination]"}
    plan = plan_of("[[90, 400], [90, 0]]", model="fluid", flow_rate="1 l/h", **fields)
    assert "homogenize.fields: without stress, coordination: there are no particles" in plan.notes


def orifice(model: str, rate: str, diameter: str = "6 mm") -> Plan:
    """Flat bottom with a hole of 48 mm, or for a fluid a pipe of that width."""
    wall = "[[24, 300], [24, 0]]" if model == "fluid" else "[[60, 100], [60, 0], [24, 0], [24, -6]]"
    return plan_of(wall, size=f"{{diameter: {diameter}}}", model=model, flow_rate=rate, dem__max_time="10 s")


@pytest.mark.parametrize("model", ["fluid", "dem"])
def test_no_more_is_asked_of_an_opening_than_falls_freely(model: str) -> None:
    """0.742 kg/s were measured at D = 8 d = 48 mm, d = 6 mm, 2500 kg/m³; the law is good to 10 %."""
    with pytest.raises(CaseError, match=r"times the free discharge through the outlet") as refusal:
        orifice(model, f"{1.2 * 0.742} kg/s")
    assert refusal.value.key == ("flow_rate",)
    (note,) = [note for note in orifice(model, f"{0.8 * 0.742} kg/s").notes if "flow_rate" in note]
    assert "inertia" in note
    assert any("flow_rate" in note for note in orifice(model, f"{0.12 * 0.742} kg/s").notes)
    assert not any("flow_rate" in note for note in orifice(model, f"{0.08 * 0.742} kg/s").notes)
    with pytest.raises(CaseError, match="times the free discharge"):
        orifice(model, "1e9 t/h")


def test_below_a_steep_cone_more_falls_as_rose_and_tanaka_say() -> None:
    """Through 48 mm below a cone of 20°, spheres of 2 mm: Beverloo times (tan 20°)^−0.35 = 1.424."""
    most = 0.58 * math.sqrt(9.81) * (0.048 - 1.4 * 0.002) ** 2.5 * 1.4245
    plan_of(hopper(20), flow_rate=f"{0.995 * most} m^3/s", model="dem", dem__max_time="10 s")
    with pytest.raises(CaseError, match="times the free discharge"):
        plan_of(hopper(20), flow_rate=f"{1.005 * most} m^3/s", model="dem", dem__max_time="10 s")


def test_a_mass_flow_of_unknown_packing_is_taken_at_that_of_spheres() -> None:
    """0.58 of 2500 kg/m³ is 1450 kg/m³; 1500 where the case says so."""
    most = 0.58 * math.sqrt(9.81) * (0.18 - 1.4 * 0.002) ** 2.5
    for bulk, density in (("wall_friction_angle: 20 deg", 1450.0), ("bulk_density: 1500", 1500.0)):
        kind = {"bulk": bulk, "model": "dem", "dem__max_time": "10 s"}
        plan_of("[[90, 400], [90, 0]]", flow_rate=f"{0.995 * most * density} kg/s", **kind)
        with pytest.raises(CaseError, match="times the free discharge"):
            plan_of("[[90, 400], [90, 0]]", flow_rate=f"{1.005 * most * density} kg/s", **kind)


def test_openings_beside_each_other_share_the_flow() -> None:
    """A free ring leaves a hole of 60 mm and a gap of 30 mm: neither bounds the flow alone, both together do."""
    ring = "{ring: [[30, 190], [60, 190], [60, 200], [30, 200]]}"
    kind = {"model": "dem", "outline__obstacles": ring, "dem__max_time": "10 s"}
    wide = "[[90, 400], [90, 0]]"
    inside = 0.58 * math.sqrt(9.81) * (0.06 - 1.4 * 0.002) ** 2.5
    beside = 1.03 * math.sqrt(9.81) * math.pi * 0.15 * (0.03 - 1.4 * 0.002) ** 1.5
    plan_of(wide, flow_rate=f"{0.99 * (inside + beside)} m^3/s", **kind)
    with pytest.raises(CaseError, match="free discharge through the openings at the level of the"):
        plan_of(wide, flow_rate=f"{1.01 * (inside + beside)} m^3/s", **kind)


def test_more_falls_through_a_steep_cone_but_not_more_than_half_as_much_again() -> None:
    free = 0.58 * math.sqrt(9.81) * (0.048 - 1.4 * 0.002) ** 2.5
    for half_angle, factor in ((10, 1.5), (30, math.tan(math.radians(30)) ** -0.35), (50, 1.0)):
        plan_of(hopper(half_angle), flow_rate=f"{0.99 * factor * free} m^3/s", **said(half_angle))
        with pytest.raises(CaseError, match="free discharge"):
            plan_of(hopper(half_angle), flow_rate=f"{1.01 * factor * free} m^3/s", **said(half_angle))


def test_an_annulus_is_an_opening() -> None:
    annular = {"model": "fluid", "fluid__outlet_profile": "annular"}
    with pytest.raises(CaseError, match=r"annular outlet is .* no particle passes it") as refusal:
        plan_of("[[90, 400], [90, 0]]", fluid__annulus="[0.03, 0.0300001]", **annular)
    assert refusal.value.key == ("fluid", "annulus")
    assert plan_of("[[90, 400], [90, 0]]", fluid__annulus="[0.03, 0.06]", **annular).breaches == ()


RING = "{ring: [[60, 190], [%s, 190], [%s, 200], [60, 200]]}"


@pytest.mark.parametrize("model", ["dem", "hybrid", "fluid"])
def test_a_gap_that_no_particle_passes_asks_whether_it_should_touch(model: str) -> None:
    sections = "{a: [400, 300], b: [300, 150], c: [150, 0]}"
    kind = {"model": model, "dem__max_time": "100 s", "outline__sections": sections}
    with pytest.raises(
        CaseError, match=r"no particle passes it.* move the points at r = 0\.089 m to r = 0\.09 m"
    ) as no:
        plan_of("[[90, 400], [90, 0]]", outline__obstacles=RING % (89, 89), **kind)
    assert no.value.key == ("outline", "obstacles", "ring")


def test_one_rule_holds_for_gaps_beside_an_obstacle_and_for_outlets() -> None:
    def marks(gap: float, where: str) -> str:
        ring = {"outline__obstacles": RING % (90 - gap, 90 - gap)} if where == "ring" else {}
        wall = "[[90, 400], [90, 0]]" if where == "ring" else f"[[90, 400], [90, 200], [{gap / 2}, 0]]"
        try:
            plan = plan_of(wall, model="dem", dem__max_time="100 s", flow_rate="1 mg/s", **ring)
        except CaseError as refusal:
            return "refused" if "d90" in str(refusal) else "closed"
        decision = next(d for d in plan.decisions if "gap/d90" in d.name and d.value == f"{gap / 2:.3g}")
        return "noted" if decision.warning else "good"

    for gap, wanted in ((1, "closed"), (6, "refused"), (7.4, "refused"), (12, "noted"), (22, "good")):
        assert [marks(gap, where) for where in ("ring", "cone")] == [wanted, wanted], gap


def test_a_slanted_gap_that_no_particle_passes_is_named_by_its_place() -> None:
    rings = "{upper: [[40, 250], [60, 200], [40, 150]], lower: [[30, 50], [50, 50], [40, 149.9]]}"
    with pytest.raises(CaseError, match="no particle passes it"):
        plan_of("[[90, 400], [90, 0]]", outline__obstacles=rings, model="dem", dem__max_time="100 s")
