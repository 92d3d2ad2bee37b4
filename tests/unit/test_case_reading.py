"""Case files into resolved cases: what is accepted, and that every wrong input is refused where it stands."""

import copy
import math
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granpipe.case.reader import load_case, read_case, resolve
from granpipe.case.yamlfile import Places, parse_yaml
from granpipe.errors import CaseError, GranpipeError

MINIMAL = """\
name: small
outline:
  wall: [[0.2, 1.0], [0.2, 0.5],
         [0.1, 0.2], [0.1, 0.0]]
material:
  density: 1000
  size: {radius: 1 cm}
flow_rate: 1 m^3/h
"""


def case_of(text, **overrides):
    data, places = parse_yaml(text, "small.yaml")
    return resolve(data, places, {key.replace("__", "."): value for key, value in overrides.items()}).case


def with_set(key, value):
    data, places = parse_yaml(MINIMAL, "small.yaml")
    return resolve(data, places, {key: value}).case


def message(text):
    with pytest.raises(CaseError) as caught:
        case_of(text)
    assert caught.value.exit_status == 2
    return str(caught.value)


def test_minimal_case_gets_documented_defaults():
    case = case_of(MINIMAL)
    assert case.model == "auto"
    assert case.contact.model == "hertz"
    assert case.contact.youngs_modulus == "auto"
    assert (case.contact.poisson, case.contact.restitution, case.contact.friction) == (0.35, 0.43, 0.73)
    assert (case.contact.rolling_model, case.contact.rolling_friction) == ("epsd2", 0.21)
    assert case.dem.time_step == case.dem.plate_speed == case.dem.ranks == "auto"
    assert (case.dem.coarse_grain_factor, case.dem.seed, case.dem.outlet) == (1.0, 1, "plate")
    assert (case.homogenize.method, case.homogenize.cell) == ("psi", "auto")
    assert (case.fluid.order, case.fluid.walls) == (2, "moving")
    assert case.export == ("comsol", "vtk")
    assert case.figures == ("rz", "vessel")
    assert case.outline.obstacles == {}


def test_units_end_in_si():
    case = with_set("material", "{density: 1 g/cm^3, internal_friction_angle: 40 deg, size: {diameter: 2 cm}}")
    assert case.material.density == 1000
    assert case.material.internal_friction_angle == pytest.approx(math.radians(40))
    assert case.material.size.radii.mono == 0.01


def test_flow_rate_is_volume_or_mass():
    assert with_set("flow_rate", "36 m^3/h").flow_rate.volume == pytest.approx(0.01)
    assert with_set("flow_rate", "36 m^3/h").flow_rate.mass is None
    assert with_set("flow_rate", "36[t/h]").flow_rate.mass == pytest.approx(10)


def test_outline_unit_scales_walls_obstacles_and_sections_but_not_factors():
    metres = case_of(
        MINIMAL.replace("[0.1, 0.0]]", "[0.1, 0.0]]\n  obstacles: {cone: [[0, 0.9], [0.05, 0.8], [0, 0.8]]}\n"
                        "  sections: {a: [1, 0.5], b: {z: [0.5, 0], wall_factor: 2/3}}")
    )  # fmt: skip
    millimetres = case_of(
        MINIMAL.replace("[[0.2, 1.0], [0.2, 0.5],", "[[200, 1000], [200, 500],").replace(
            "[0.1, 0.2], [0.1, 0.0]]",
            "[100, 200], [100, 0]]\n  unit: mm\n  obstacles: {cone: [[0, 900], [50, 800], [0, 800], [0, 900]]}\n"
            "  sections: {b: {z: [500, 0], wall_factor: 2/3}, a: [1000, 500]}",
        )
    )
    assert millimetres == metres
    assert metres.outline.sections["b"].wall_factor == pytest.approx(2 / 3)
    assert list(millimetres.outline.sections) == ["a", "b"]
    assert metres.outline.obstacles["cone"] == ((0, 0.9), (0.05, 0.8), (0, 0.8))


def test_sections_follow_the_wall_slope_unless_given():
    wall = "[[1.0, 5.9], [1.0, 5.0], [1.0, 4.9], [0.5, 3.9], [0.5, 3.4], [1.156, 3.4], [1.156, 0]]"
    sections = with_set("outline.wall", wall).outline.sections
    assert {name: (s.z_top, s.z_bottom) for name, s in sections.items()} == {
        "s1": (5.9, 4.9),
        "s2": (4.9, 3.9),
        "s3": (3.9, 3.4),
        "s4": (3.4, 0.0),
    }


def test_ledge_between_equal_slopes_separates_sections():
    sections = with_set("outline.wall", "[[1, 3], [1, 2], [0.5, 2], [0.5, 0]]").outline.sections
    assert [(s.z_top, s.z_bottom) for s in sections.values()] == [(3, 2), (2, 0)]


def arc(r: float, z: float, radius: float, degrees: int) -> str:
    """A wall that turns inwards from the vertical at (r, z), in chords of 5°."""
    angles = [math.radians(5 * i) for i in range(1, degrees // 5 + 1)]
    points = [(r - radius * (1 - math.cos(a)), z - radius * math.sin(a)) for a in angles]
    return ", ".join(f"[{r:.6f}, {z:.6f}]" for r, z in points)


def spans(wall: str) -> list[tuple[float, float]]:
    sections = with_set("outline.wall", wall).outline.sections
    return [(round(s.z_top, 3), round(s.z_bottom, 3)) for s in sections.values()]


def test_a_curved_wall_is_one_section():
    below = round(2.5 - 1.8 * math.sin(math.radians(60)), 3)
    wall = f"[[2, 3], [2, 2.5], {arc(2, 2.5, 1.8, 60)}, [0.7, 0.2], [0.7, 0]]"
    assert spans(wall) == [(3, 2.5), (2.5, below), (below, 0.2), (0.2, 0)]


def test_a_rounding_between_two_walls_belongs_to_the_one_that_slopes_more():
    assert spans(f"[[1, 3], [1, 2], {arc(1, 2, 0.1, 30)}, [0.4, 1], [0.4, 0]]") == [(3, 2), (2, 1), (1, 0)]


def test_short_walls_that_turn_sharply_and_long_ones_that_turn_little_are_sections_each():
    assert spans("[[1, 3], [1, 2], [0.98, 1], [0.9, 0]]") == [(3, 2), (2, 1), (1, 0)]
    assert spans("[[1, 3], [1, 2], [0.9, 1.95], [0.9, 1.9], [0.8, 0]]") == [(3, 2), (2, 1.95), (1.95, 1.9), (1.9, 0)]


@pytest.mark.parametrize(
    ("size", "kind", "expected"),
    [
        ("{radius: 1 cm}", "mono", {"mono": 0.01}),
        ("{diameter: 2 cm}", "mono", {"mono": 0.01}),
        (
            "{diameter: {normal: {mean: 4 cm, std: 1 cm, min: 2 cm, max: 6 cm}}}",
            "normal",
            {"normal": {"mean": 0.02, "std": 0.005, "min": 0.01, "max": 0.03}},
        ),
        (
            "{diameter: {lognormal: {median: 4 cm, sigma: 0.3, min: 2 cm, max: 8 cm}}}",
            "lognormal",
            {"lognormal": {"median": 0.02, "sigma": 0.3, "min": 0.01, "max": 0.04}},
        ),
        (
            "{diameter: {sieve: {edges: [2 cm, 4 cm, 8 cm], fractions: [25 %, 75 %]}}, by: mass}",
            "sieve",
            {"sieve": {"edges": (0.01, 0.02, 0.04), "fractions": (0.25, 0.75)}},
        ),
    ],
)
def test_sizes_resolve_to_radii(size, kind, expected):
    resolved = with_set("material.size", size).material.size
    assert resolved.kind == resolved.radii.kind == kind
    found = getattr(resolved.radii, kind)
    wanted = expected[kind]
    assert (found if kind == "mono" else {key: getattr(found, key) for key in wanted}) == wanted


def test_wall_contact_is_that_between_particles_where_not_given():
    wall = with_set("contact", "{friction: 0.4, restitution: 0.6, wall: {friction: 0.2}}").contact.wall
    assert (wall.friction, wall.rolling_friction, wall.restitution) == (0.2, 0.21, 0.6)


def test_no_rolling_model_means_no_rolling_friction():
    contact = with_set("contact", "{rolling_model: none}").contact
    assert contact.rolling_friction == contact.wall.rolling_friction == 0


def test_group_with_nothing_but_comments_takes_its_defaults():
    text = MINIMAL.replace("flow_rate", "dem:\n  # seed: 3\nflow_rate").replace(
        "material:", "  obstacles:\n  # none\nmaterial:"
    )
    assert case_of(text) == case_of(MINIMAL)


def test_case_is_frozen():
    with pytest.raises(Exception, match="frozen"):
        case_of(MINIMAL).dem.seed = 3


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("dem.seed", "2", lambda case: case.dem.seed == 2),
        ("dem", "{seed: 2}", lambda case: case.dem.seed == 2),
        ("contact.wall.friction", "0.1", lambda case: case.contact.wall.friction == 0.1),
        ("material.size.radius", "2 cm", lambda case: case.material.size.radii.mono == 0.02),
        ("export", "[vtk]", lambda case: case.export == ("vtk",)),
        ("export", "[]", lambda case: case.export == ()),
        ("model", "dem", lambda case: case.model == "dem"),
    ],
)
def test_set_overrides_any_key(key, value, expected):
    assert expected(with_set(key, value))


def test_set_reaches_into_a_section_in_short_form(tmp_path):
    path = tmp_path / "case.yaml"
    path.write_text(MINIMAL.replace("material:", "  sections: {a: [1, 0.5], b: [0.5, 0]}\nmaterial:"))
    case = load_case(path, {"outline.sections.b.regime": "mass_flow"})
    assert case.outline.sections["b"].regime == "mass_flow"
    assert case.outline.sections["b"].z == (0.5, 0)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("dem.sede", "2", "--set dem.sede: unknown key; did you mean `seed`?"),
        ("nonsense.deep", "2", "--set nonsense: unknown key"),
        ("name.x", "2", "--set name: is a single value in the case"),
        ("dem..seed", "2", "--set: `dem..seed` is not a dotted key"),
        ("", "2", "--set: `` is not a dotted key"),
        ("dem.seed", "[1", "--set dem.seed: not YAML"),
        ("dem.seed", "", "--set dem.seed: no value; must be a whole number"),
        ("material", "", "--set material.density: missing"),
        ("outline.wall", "[[1, 1], [3[cm], 0]]", "outline.unit"),
    ],
)
def test_wrong_override_is_refused(key, value, says):
    with pytest.raises(CaseError) as caught:
        with_set(key, value)
    assert says in str(caught.value)


def test_message_has_file_line_key_value_and_remedy():
    text = MINIMAL + "contact:\n  poisson: 0.3\n  restitution: 1.3\n"
    assert message(text) == "small.yaml:11 contact.restitution: 1.3; must be in (0.05, 1]"


def test_first_wrong_line_is_told_with_the_number_of_others():
    text = MINIMAL.replace("1000", "-5") + "dem: {seed: -1}\n"
    assert message(text) == "small.yaml:6 material.density: -5; must be in [1, 30000] kg/m^3 (and 1 more)"


def test_point_of_the_wall_has_its_own_line():
    assert message(MINIMAL.replace("[0.1, 0.2]", "[0.1, x]")).startswith("small.yaml:4 outline.wall[2]: [0.1, 'x']; ")


def test_unknown_key_suggests_the_nearest():
    assert message(MINIMAL + "flowrate: 1 t/h\n") == "small.yaml:9 flowrate: unknown key; did you mean `flow_rate`?"


def test_unknown_key_without_likeness_lists_the_known():
    assert "known here: rheology, order" in message(MINIMAL + "fluid: {qqq: 1}\n")


@pytest.mark.parametrize("key", ["name", "outline", "material", "flow_rate"])
def test_missing_key_is_named(key):
    blocks = re.split(r"^(?=\w)", MINIMAL, flags=re.MULTILINE)
    text = "".join(block for block in blocks if not block.startswith(f"{key}:"))
    assert message(text).startswith(f"small.yaml {key}: missing; give it: ")


def test_missing_key_in_a_group_is_placed_at_the_group():
    assert message(MINIMAL.replace("  density: 1000\n", "")).startswith(
        "small.yaml:5 material.density: missing; give it"
    )


WRONG = {
    "name": ["a b", "'../up'", "''", "-x", "x/y", "[1]", "true", '"x\\ny"', "x" * 65, "ä"],
    "outline.unit": ["kg", "3", "m/s", "parrot", ""],
    "outline.wall": ["[]", "[[1, 1]]", "3", "", "[1, 2]", "[[1, 2, 3], [1, 0, 0]]", "[[1e9, 1], [1, 0]]",
                     "[[true, 1], [1, 0]]", "[[1e999, 1], [1, 0]]",
                     "[['1 m', 1], [1, 0]]"],
    "outline.obstacles": ["[1]", "{a: [[0, 0], [1, 1], [0, 0]]}", "{a-b: [[0, 0], [1, 1], [0, 1]]}", "{a: }"],
    "outline.sections": ["[1]", "{a: 3}", "{a: }", "{a: [1]}", "{a: [1 m, 0]}", "{a: {z: [1, 0], regime: mass-flow}}",
                         "{a: {z: [1, 0], wall_factor: 1.5}}", "{a: {z: [1, 0], wall_factor: -0.1}}",
                         "{a: {z: [1, 0], model: hybrid}}", "{a: {regime: mass_flow}}", "{'1; rm': [1, 0]}"],
    "material.density": ["0", "-1", "1e6", "1 kg", "'1000 kg'", "[1]", "true", "dense", "9**9**9 kg/m^3"],
    "material.bulk_density": ["0", "1000", "1200", "1 m"],
    "material.internal_friction_angle": ["30", "0 deg", "90 deg", "-3 deg", "30 m"],
    "material.wall_friction_angle": ["0.5", "90 deg", "-1 deg"],
    "material.size": ["3 cm", "{}", "{normal: {mean: 1}}", "{radius: 1 cm, diameter: 2 cm}",
                      "{radius: 1 cm, by: volume}",
                      "{radius: 1 cm, classes: 0}", "{radius: 1 cm, classes: 2.5}", "{radius: 1 cm, classes: 51}"],
    "material.size.radius": ["0", "-1 cm", "11 m", "1 kg", "{}",
                             "{mono: 1 cm, normal: {mean: 1, std: 1, min: 1, max: 2}}",
                             "{normal: {mean: 3 cm, std: 1 cm}}",
                             "{normal: {mean: 3 cm, std: 0, min: 1 cm, max: 5 cm}}",
                             "{normal: {mean: 3 cm, std: 1 cm, min: 5 cm, max: 1 cm}}",
                             "{normal: {mean: 9 cm, std: 1 cm, min: 1 cm, max: 5 cm}}",
                             "{lognormal: {median: 3 cm, sigma: 0, min: 1 cm, max: 5 cm}}",
                             "{lognormal: {median: 3 cm, sigma: 1 cm, min: 1 cm, max: 5 cm}}",
                             "{uniform: 1}"],
    "contact": ["{model: hooke}", "{model: hertz, characteristic_velocity: 1}", "{model: jkr}",
                "{rolling_model: none, rolling_friction: 0.1}", "{rolling_model: none, wall: {rolling_friction: 0.1}}",
                "{rolling_model: false}", "3"],
    "contact.youngs_modulus": ["0", "-1e7", "1e20", "soft", "1 kg"],
    "contact.poisson": ["-0.1", "0.51", "1"],
    "contact.restitution": ["0", "0.05", "1.01", "-1"],
    "contact.friction": ["-0.1", "11", "x"],
    "contact.wall.restitution": ["0.05", "2"],
    "flow_rate": ["1", "0 m^3/h", "-1 t/h", "1 m", "'1e400 kg/s'", "{volume: 1}", "fast", ""],
    "model": ["DEM", "1", "[dem]", "{}"],
    "dem.coarse_grain_factor": ["0.5", "0", "-2", "1000"],
    "dem.plate_speed": ["0", "-0.1", "1000", "1 m"],
    "dem.time_step": ["0", "-1e-5", "2", "1 m"],
    "dem.max_time": ["0", "-1", "long", "1e9"],
    "dem.seed": ["-1", "1.5", "'1'", "true", "99999999999", "auto"],
    "dem.outlet": ["closed", "true"],
    "dem.reservoir_height": ["0", "-1", "1e9"],
    "dem.ranks": ["0", "1.0", "99999"],
    "dem.keep_snapshots": ["some", "true"],
    "dem.statistical_error": ["0", "100 %", "5 cm"],
    "dem.replicas": ["0", "1.5"],
    "dem.target_error": ["5 %"],
    "homogenize.cell": ["0", "-1", "100"],
    "homogenize.method": ["gauss"],
    "homogenize.start": ["-1", "2e6", "1 m"],
    "homogenize.smoothing_passes": ["-1", "101", "1.5"],
    "fluid.order": ["1", "5", "2.0"],
    "fluid.walls": ["sticky"],
    "export": ["vtk", "[vtk, vtk]", "[xls]", "[[vtk]]", "[{}]", "3"],
    "figures": ["[rz, xy]", "all"],
}  # fmt: skip


@pytest.mark.parametrize(("key", "value"), [(key, value) for key, values in WRONG.items() for value in values])
def test_wrong_value_is_refused_on_one_line_at_its_key(key, value):
    with pytest.raises(CaseError) as caught:
        with_set(key, value)
    text = str(caught.value)
    assert text.startswith(f"--set {key}")
    assert "\n" not in text
    assert len(text) < 400


def test_sieve_table_must_say_what_it_counts():
    with pytest.raises(CaseError, match=r"material.size.by: missing; say by: mass or by: number"):
        with_set("material.size", "{diameter: {sieve: {edges: [1 cm, 2 cm], fractions: [1]}}}")


@pytest.mark.parametrize(
    ("sieve", "says"),
    [
        ("{edges: [1 cm, 2 cm], fractions: [0.5]}", "must add up to 1"),
        ("{edges: [1 cm, 2 cm], fractions: [0.5, 0.5]}", "must be 1 fractions"),
        ("{edges: [2 cm, 1 cm], fractions: [1]}", "must rise"),
        ("{edges: [1 cm, 1 cm], fractions: [1]}", "must rise"),
        ("{edges: [0, 1 cm], fractions: [1]}", "must be in (0, 10] m"),
        ("{edges: [1 cm], fractions: []}", "must be a list of 2 or more"),
        ("{edges: [1 cm, 2 cm, 3 cm], fractions: [1.5, -0.5]}", "must be in [0, 1]"),
    ],
)
def test_inconsistent_sieve_table_is_refused(sieve, says):
    with pytest.raises(CaseError) as caught:
        with_set("material.size", f"{{diameter: {{sieve: {sieve}}}, by: mass}}")
    assert says in str(caught.value)


def test_section_model_must_agree_with_that_of_the_case():
    with pytest.raises(CaseError, match=r"outline.sections.a.model: dem; must agree with model: fluid"):
        case_of(MINIMAL, outline__sections="{a: {z: [1, 0], model: dem}}", model="fluid")


def test_averaging_must_begin_before_production_ends():
    with pytest.raises(CaseError, match=r"homogenize.start: 5; must be below dem.max_time \(5 s\)"):
        case_of(MINIMAL, homogenize__start="5", dem__max_time="5 s")


@pytest.mark.parametrize("density", ["990", "1000", "1200", "50"])
def test_bulk_that_does_not_pack_like_a_bulk_is_refused(density):
    with pytest.raises(CaseError, match=r"packing fraction must be in \[0\.1, 0\.85\]") as refused:
        case_of(MINIMAL, material__bulk_density=density)
    assert refused.value.key == ("material", "bulk_density")


def test_resolved_case_loads_again_as_the_same_case():
    for overrides in (
        {},
        {"name": "1e5x", "material.internal_friction_angle": "40 deg", "flow_rate": "3 t/h"},
        {"material.size": "{diameter: {sieve: {edges: [1 cm, 2 cm, 35 mm], fractions: [1/3, 2/3]}}, by: mass}"},
        {"contact": "{model: hooke, characteristic_velocity: 1, rolling_model: none, youngs_modulus: 4.7e9}"},
        {"outline": "{unit: ft, wall: [[3, 5.1], [1, 0]], sections: {x: {z: [5.1, 0], wall_factor: 2/3, model: dem}}}"},
        {"dem": "{time_step: 1e-5, keep_snapshots: none}", "export": "[]"},
    ):
        data, places = parse_yaml(MINIMAL, "small.yaml")
        case = resolve(data, places, overrides).case
        again, places = parse_yaml(case.to_yaml(), "again.yaml")
        assert resolve(again, places).case == case
        assert resolve(again, places).case.to_yaml() == case.to_yaml()


def test_case_named_like_a_number_keeps_its_name():
    case = with_set("name", "'1e5'")
    assert case.name == "1e5"
    assert case_of(case.to_yaml()).name == "1e5"


def test_case_file_locates_keys_for_errors_raised_later(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(MINIMAL)
    found = read_case(path, {"dem.seed": "3"})
    later = found.places.explain(CaseError("too narrow", ("outline", "wall", 2)))
    assert str(later) == "mine.yaml:4 outline.wall[2]: too narrow"
    assert found.places.locate(("dem", "seed")) == "--set"
    assert found.places.locate(("contact", "friction")) == "mine.yaml"


def _paths(data, path=()):
    yield path
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield from _paths(value, (*path, key))


REACTOR = parse_yaml((Path(__file__).parents[2] / "cases" / "reactor.yaml").read_text(), "reactor.yaml")[0]
ODD = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=6), st.just([]), st.just({}),
    st.lists(st.floats(), max_size=3), st.lists(st.lists(st.floats(), max_size=3), max_size=3),
    st.dictionaries(st.text(max_size=4), st.none() | st.floats(), max_size=2),
    st.sampled_from(["auto", "3 cm", "30 deg", "5 %", "{text}", "%s", "none", "1/0", "9**9**9 m", [["a"]], {"z": 3}]),
)  # fmt: skip


@settings(max_examples=120, deadline=None)
@given(st.data())
def test_any_damage_to_a_case_ends_in_a_case_or_a_case_error(data):
    raw = copy.deepcopy(REACTOR)
    for _ in range(data.draw(st.integers(1, 2))):
        path = data.draw(st.sampled_from([path for path in _paths(raw) if path]))
        group = raw
        for key in path[:-1]:
            group = group[key]
        if isinstance(group, dict) and data.draw(st.booleans()):
            group[data.draw(st.sampled_from(["zz", "size", "model", "wall", ""]))] = copy.deepcopy(data.draw(ODD))
        else:
            group[path[-1]] = copy.deepcopy(data.draw(ODD))
    try:
        case = resolve(raw, Places("x.yaml")).case
    except GranpipeError as error:
        refusal = error
    else:
        refusal = None
        again, places = parse_yaml(case.to_yaml(), "again.yaml")
        assert resolve(again, places).case == case
    assert refusal is None or (isinstance(refusal, CaseError) and "\n" not in str(refusal))


@pytest.mark.parametrize(
    ("key", "value", "new"),
    [
        ("homogenize.method", "paper", "method: gaussian"),
        ("fluid.outlet", "plate", "outlet_profile: uniform"),
        ("fluid.outlet", "open", "outlet_profile: developed"),
        ("fluid.outlet", "annular", "outlet_profile: annular"),
        ("fluid.outlet", "[1, 2]", r"outlet_profile: \[1, 2\]"),
        ("fluid.outlet_profile", "plate", "outlet_profile: uniform"),
    ],
)
def test_former_names_are_refused_with_the_new_ones(key, value, new):
    with pytest.raises(CaseError, match=rf"renamed: write {new}") as refused:
        with_set(key, value)
    assert refused.value.key == tuple(key.split("."))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            "flow_rate: 1 m^3/h",
            "flow_rate: 1 m^3/h\ncontact: {friction: 0,3}",
            "contact.3: decimals .*: friction: 0.3$",
        ),
        ("flow_rate: 1 m^3/h", "flow_rate: 1 m^3/h\ndem: {max_time: 8,5}", "dem.5: decimals .* point: max_time: 8.5$"),
        ("flow_rate: 1 m^3/h", "flow_rate: 1 m^3/h\ndem: {max_time: 8,5 s}", "dem.5 s: decimals .*: max_time: 8.5 s$"),
        ("[0.1, 0.0]", "[0,1, 0]", "wall.*two plain numbers; decimals are written with a point"),
        ("[0.1, 0.0]", "[0,1, 0,0]", "wall.*two plain numbers; decimals are written with a point"),
    ],
)
def test_a_decimal_comma_is_explained(old, new, says):
    assert re.search(says, message(MINIMAL.replace(old, new)))


def test_a_key_that_begins_with_a_digit_is_just_unknown():
    assert "did you mean" in message(MINIMAL + "contact: {friction: 0.3, 3riction: 0.1}\n")


@pytest.mark.parametrize(("value", "says"), [("[40, 60]", "write 40 %"), ("[0.4, 60]", "write 60 %")])
def test_a_bare_percentage_is_explained(value, says):
    sieve = f"{{radius: {{sieve: {{edges: [1 cm, 2 cm, 3 cm], fractions: {value}}}}}, by: mass}}"
    assert says in message(MINIMAL.replace("{radius: 1 cm}", sieve))


@pytest.mark.parametrize(("coding", "says"), [("utf-16", "UTF-16 text"), ("latin-1", r"\.yaml:2: not UTF-8 .*Latin-1")])
def test_other_text_codings_are_named_with_the_remedy(tmp_path, coding, says):
    path = tmp_path / "case.yaml"
    path.write_bytes(("# first\n# Schütte\n" + MINIMAL).encode(coding))
    with pytest.raises(CaseError, match=says) as refused:
        read_case(path)
    assert "save the file as UTF-8" in str(refused.value)
