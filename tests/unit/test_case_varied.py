"""A varied case is the case that its file would give with the same keys set."""

from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from granpipe.case.reader import read_case, varied
from granpipe.errors import CaseError

CASES = sorted((Path(__file__).parents[2] / "cases").glob("*.yaml"))
BASES = {path: read_case(path).case for path in CASES}

VALUES = {
    "name": ["other"],
    "outline.sections.a": ["[5.9, 5.0]", "{z: [5.9, 4.9], wall_factor: 0.9}"],
    "outline.sections.b.wall_factor": ["0.5", "2/3"],
    "outline.obstacles": ["{cone: [[0, 5.0], [0.1, 4.9], [0, 4.9]]}", "{}"],
    "outline.wall": ["[[1.0, 5.9], [0.5, 3.9], [0.5, 0.0]]"],
    "material.density": ["2 g/cm^3", "1500"],
    "material.bulk_density": ["0.5 g/cm^3", "600"],
    "material.internal_friction_angle": ["40 deg", "0.7 rad"],
    "material.size": ["{radius: 4 cm}", "{diameter: {lognormal: {median: 5cm, sigma: 0.3, min: 2cm, max: 9cm}}}"],
    "material.size.classes": ["3"],
    "contact": ["{friction: 0.2}", "{rolling_model: none}", "{model: hooke, characteristic_velocity: 1 m/s}"],
    "contact.friction": ["0.1", "55 %"],
    "contact.restitution": ["0.7"],
    "contact.rolling_model": ["none", "cdt"],
    "contact.rolling_friction": ["0", "0.4"],
    "contact.wall": ["{friction: 0.3}", "{}"],
    "contact.wall.friction": ["0.25"],
    "contact.wall.rolling_friction": ["0"],
    "contact.youngs_modulus": ["auto", "5e6 Pa", "0.1 GPa"],
    "flow_rate": ["2 t/h", "3[m^3/h]"],
    "model": ["auto", "dem", "fluid"],
    "dem.seed": ["7"],
    "dem.coarse_grain_factor": ["3"],
    "dem.max_time": ["90 s", "1 min"],
    "dem.ranks": ["auto", "2"],
    "homogenize": ["{method: gaussian, start: 2 s}"],
    "homogenize.cell": ["2 cm", "auto"],
    "fluid.outlet_profile": ["uniform"],
    "export": ["[vtk]", "[]"],
    "figures": ["[]"],
}

CHANGES = st.lists(
    st.sampled_from(sorted(VALUES)).flatmap(lambda key: st.tuples(st.just(key), st.sampled_from(VALUES[key]))),
    min_size=1,
    max_size=4,
).map(dict)


def outcome(make):
    """The case, or that it is refused."""
    try:
        return make()
    except CaseError:
        return "refused"


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(CASES), CHANGES)
@example(CASES[0].with_name("two_outlets.yaml"), {"outline.obstacles": "{}"})
def test_varied_is_what_the_file_would_give(path, changes):
    in_metres = {"outline.unit": "m"} if any(key.startswith("outline.") for key in changes) else {}
    base = BASES[path]
    if in_metres and base.vessel is None:  # a vessel in space has no outline: such changes are refused
        base = read_case(path, in_metres).case
    wanted = outcome(lambda: read_case(path, in_metres | changes).case)
    assert outcome(lambda: varied(base, changes)) == wanted


def test_values_for_every_key_are_accepted_by_some_case():
    for key, texts in VALUES.items():
        for text in texts:
            assert any(outcome(lambda c=case, k=key, t=text: varied(c, {k: t})) != "refused" for case in BASES.values())


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_no_change_is_the_same_case(path):
    assert varied(BASES[path], {}) == BASES[path]
    assert varied(BASES[path], {}).to_yaml() == BASES[path].to_yaml()


def test_changes_add_up():
    base = BASES[CASES[0]]
    both = varied(base, {"contact.friction": "0.2", "dem.seed": "3"})
    assert varied(varied(base, {"contact.friction": "0.2"}), {"dem.seed": "3"}) == both


def test_wall_follows_the_particles_unless_it_is_given():
    base = read_case(CASES[0], {"contact": "{friction: 0.5, wall: {restitution: 0.6}}"}).case
    changed = varied(base, {"contact.friction": "0.2", "contact.restitution": "0.9"})
    assert changed.contact.wall.friction == 0.2
    assert changed.contact.wall.restitution == 0.6


def test_wrong_change_is_refused_with_its_key():
    base = BASES[CASES[0]]
    with pytest.raises(CaseError, match=r"contact\.restitution: 1\.3; must be in \(0\.05, 1\]"):
        varied(base, {"contact.restitution": "1.3"})
    with pytest.raises(CaseError, match="did you mean `seed`"):
        varied(base, {"dem.sed": "1"})
