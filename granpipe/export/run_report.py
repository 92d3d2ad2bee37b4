"""``report.html`` of a run and of averaged dumps: the verdict first, then the pictures, then the details."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from granpipe.errors import DataError
from granpipe.export.pictures import flow_text, readable_unit
from granpipe.export.report import Link, Number, Picture, Section, Verdict, write_page
from granpipe.progress import duration_text
from granpipe.system.jsonfile import read_json

Data = Mapping[str, Any]

BULK_TEXT = (
    "Soft particles overlap and pack too densely; packings and solids flows are corrected for it by the factor below, "
    "so that the reference density times the bulk velocity is the mass flux of the material."
)
CITATION = (
    "granpipe: granular flow in vessels, from an outline or a drawing to a velocity field for multiphysics programs",
    "Granular flow described by fictitious fluids: a suitable methodology for process simulations",
)
"""Titles of the program and of the article whose method it implements, as in CITATION.cff."""

PANELS = {
    "packing": (
        "Packing fraction",
        "Share of the volume that particles fill. White: no solids, or outside the vessel.",
    ),
    "u": ("Radial velocity", "Bulk velocity away from the axis; red: outwards, blue: towards the axis."),
    "w": ("Vertical velocity", "Bulk velocity; negative: downwards."),
    "streamlines": ("Streamlines", "Between two lines flows a tenth of the solids. Brown: at rest."),
    "error": (
        "Standard error of the bulk velocity",
        "Where it is near the velocity itself, the pattern there is noise.",
    ),
    "pressure": (
        "Pressure in the solids",
        "Mean of the three normal stresses, from the forces between particles. It does not depend on the flow rate.",
    ),
    "shear_rate": ("Shear rate", "How fast the bulk is sheared. White also where a wall cuts the cells of the grid."),
    "granular_temperature": (
        "Granular temperature",
        "Its root: the scatter of the particles' velocities about their mean, in each direction. In slow flow it goes "
        "with the flow rate.",
    ),
    "coordination": ("Contacts per particle", "Contacts with other particles; those with walls do not count."),
    "mixing_index": (
        "Mixing of the sizes",
        "Lacey's index of each height: 0 sizes wholly apart, 1 mixed at random. White where there is one size alone.",
    ),
    "age": (
        "Age of the solids",
        "Time since they came in through the inlet. White where no streamline from the inlet comes by.",
    ),
    "sensitivity": (
        "Sensitivity",
        "By how much the bulk velocity changes with 20 % more or less wall friction, and with surfaces 5° flatter or "
        "steeper. No noise, and not the whole error of the model.",
    ),
}
_SLAB_PANELS = {"u": ("Horizontal velocity", "Bulk velocity along x; red: to the right, blue: to the left.")}
FILES = {
    "field.npz": "the field, for Python: `granpipe.load_result`",
    "field.vtu": "the field, for ParaView",
    "field.vtr": "the field in space, for ParaView",
    "fluid.vtu": "the fictitious fluid on its own mesh, for ParaView",
    "case.yaml": "the case, with every default",
    "plan.json": "what was planned, and why",
    "failure.json": "why there is no field",
    "level_flow.csv": "flow through every level over that of the plate",
    "provenance.json": "all measured figures, versions, seeds, times",
    "import_comsol.java": "adds all of this to a COMSOL model",
    "import_comsol.py": "the same from Python, by MPh",
    "flow.nc": "the field as NetCDF",
    "flow.xdmf": "the field for FEniCSx",
    "streamlines.csv": "streamlines with residence times",
    "psi_grid.txt": "stream function on r² (x in a slab) and z, for COMSOL",
    "flow_sectionwise.txt": "velocities on triangles of the solids, for COMSOL",
    "v_grid.txt": "velocity along y on a grid, for COMSOL",
    "u_grid.txt": "radial (horizontal) velocity on a grid, for COMSOL",
    "w_grid.txt": "vertical velocity on a grid, for COMSOL",
    "phi_grid.txt": "packing on a grid, for COMSOL",
    "flow_spreadsheet.txt": "all quantities as one table, for COMSOL",
    "flow_levels.txt": "flow through every level, divergence",
}
PROGRAMS = {
    "openfoam": "for OpenFOAM",
    "fluent": "for Ansys Fluent",
    "starccm": "for STAR-CCM+",
    "moose": "for MOOSE",
    "ngsolve": "for NGSolve",
}
COMSOL_STEPS = (
    "In the folder comsol/ run: comsol compile import_comsol.java",
    "Then: comsol batch -inputfile import_comsol.class -outputfile ../../flow.mph. Instead of both, from Python: "
    "pip install mph, then python import_comsol.py ../../flow.mph",
    "Open flow.mph in COMSOL Desktop: it has a 2D axisymmetric component with the variables u_solids and w_solids. "
    "Draw or import your geometry in metres; r = 0 is the axis, and z is that of the case.",
    "Use u_solids and w_solids as the velocity field of your physics, and rho_ref as its density: "
    "their product is the mass flux.",
    "Check: the surface integral of w_solids over the outlet must be −flow_rate.",
)
SLAB_STEPS = {
    2: "Open flow.mph in COMSOL Desktop: it has a 2D component with the variables u_solids and w_solids. "
    "Draw or import your geometry in metres; x is that of the case, and y is its z.",
    4: "Check: the line integral of w_solids over the outlet times depth_ref must be −flow_rate.",
}
"""What stands in the place of `COMSOL_STEPS` for a slab."""


def write_run_report(folder: Path) -> None:
    """Write ``report.html`` of a folder of results, from the files in it; averaged dumps have no ``plan.json``.

    Raises
    ------
    DataError : a file is missing or damaged
    """
    provenance = read_json(folder / "provenance.json")
    plan = read_json(folder / "plan.json") if (folder / "plan.json").exists() else None
    try:
        title = provenance["case"] or "Averaged dumps"
        sections = list(_sections(folder, plan, provenance))
        intro = [f"{_made(provenance)}, {_model(plan, provenance)}."]
        write_page(
            folder / "report.html", title, intro, sections, verdict(plan, provenance), list(_numbers(plan, provenance))
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DataError(f"{folder}: damaged ({error!r}); delete it and run again") from None


def write_failure_report(folder: Path) -> None:
    """Write ``report.html`` of what a run without a field has left, from the files in it: why, and what to do.

    Raises
    ------
    DataError : a file is missing or damaged
    """
    failure, plan = read_json(folder / "failure.json"), read_json(folder / "plan.json")
    try:
        told = Verdict("failed", f"There is no field: {failure['text']}.")
        part = f" of the sub-model {failure['run']}" if failure["run"] != failure["case"] else ""
        intro = [
            f"The average{part} said: {failure['reason']}.",
            f"{_made(failure)}. What was simulated so far is kept; nothing here is for use in a computation.",
        ]
        sections = [*_failed_pictures(folder / "figures"), *_failed_plan(plan), *_files(folder), _versions(failure)]
        write_page(folder / "report.html", failure["case"], intro, sections, told)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DataError(f"{folder}: damaged ({error!r}); delete it and run again") from None


def _failed_pictures(folder: Path) -> Iterator[Section]:
    shown = {
        "level_flow": (
            "Flow through every level over that of the plate, for the whole run and for its last third. "
            "Of a steady flow both are 1 everywhere.",
            "Flow through every level over that of the plate.",
        ),
        "raw_average": (
            "Plain average of what was simulated, at the scale of the simulation.",
            "Plain average of packing and velocities in half of the section through the axis.",
        ),
    }
    pictures = [Picture(path, *words) for name, words in shown.items() if (path := folder / f"{name}.png").exists()]
    yield Section("What was simulated", figures=pictures)


def _failed_plan(plan: Data) -> Iterator[Section]:
    if plan["warnings"]:
        yield Section("Keep in mind", items=plan["warnings"])
    for name, one in {"": plan, **plan["submodels"]}.items():
        if "dem" in one:
            decisions = [(c["name"], c["value"], c["criterion"]) for c in one["dem"]["decisions"]]
            title = f"Settings and criteria{f' of sub-model {name}' if name else ''}"
            yield Section(title, head=("setting", "value", "criterion"), rows=decisions)


def _made(record: Data) -> str:
    return f"Made {record['made'][:16].replace('T', ' ')} by granpipe {record['granpipe']}"


def verdict(plan: Data | None, provenance: Data) -> Verdict:
    """Whether the result may be used, and how wrong it may be."""
    gates = provenance["quality"]
    failed = [gate for gate in gates if not gate["passed"]]
    if failed:
        told = "; ".join(f"{gate['name']}: {gate['value']:.3g}, must be {gate['limit']}" for gate in failed)
        return Verdict("marked", f"The result failed {len(failed)} of {len(gates)} quality gates: {told}.")
    if not gates:
        return Verdict("marked", "No quality gate applies to this field, so nothing tells whether it is right.")
    errors = [
        f"its statistical error{f' in sub-model {name}' if name else ''} is {worst}"
        for name, record in _records(provenance)
        if (worst := _worst(record["figures"].get("statistical_error", {})))
    ]
    error = "".join(f", and {one}" for one in errors)
    notes = len(_told(plan, provenance))
    mind = f" {notes} note{'s say' if notes > 1 else ' says'} what to keep in mind: see below." if notes else ""
    return Verdict("good", f"The field passed all {len(gates)} quality gates{error}.{mind}")


def _told(plan: Data | None, provenance: Data) -> list[str]:
    """What the run itself warned of."""
    told = [note for _, record in _records(provenance) for note in record.get("notes", ())]
    if plan is not None:
        told += [*plan["warnings"], *(f"Outside the range: {breach}" for breach in plan["outside_the_range"])]
    return told


def _worst(errors: Mapping[str, float]) -> str:
    """The error of the whole, and of the worst section."""
    parts = {name: error for name, error in errors.items() if name != "whole"}
    if "whole" not in errors:
        return ""
    worst = max(parts, key=lambda name: parts[name], default="")
    return _percent(errors["whole"]) + (f" (worst section {worst}: {_percent(parts[worst])})" if worst else "")


def _percent(part: float) -> str:
    return f"{100 * part:.2g} %"


def _model(plan: Data | None, provenance: Data) -> str:
    if plan is None:
        return f"from dumps; sampled by {provenance['sampling']}; method: {provenance['method']}"
    if _is_frictional(plan, provenance):
        return "from a fluid with the friction of the bulk and of the walls; no particle was simulated"
    return {
        "dem": "from a simulation of every particle (DEM)",
        "fluid": "from a fictitious fluid between moving walls; no particle was simulated",
        "hybrid": "from a fictitious fluid that follows a simulation of every particle (DEM) in some sections",
    }[plan["model"]]


def _is_frictional(plan: Data, provenance: Data) -> bool:
    """Whether the whole field is that of a frictional fluid, of which alone the sensitivity is computed."""
    return bool(plan["model"] == "fluid" and "sensitivity" in provenance["figures"])


def _records(provenance: Data) -> Iterator[tuple[str, Data]]:
    """What was measured, of the whole and of each sub-model, by its name."""
    yield "", provenance
    yield from provenance.get("submodels", {}).items()


def _numbers(plan: Data | None, provenance: Data) -> Iterator[Number]:
    """The key numbers of the first screen."""
    field = provenance.get("field", {})
    if "flow_rate_m3_per_s" in field:
        mass = field.get("mass_flow_kg_per_s")
        scale = "" if mass is not None else "at the scale of the dumps"
        note = f"{3.6 * mass:.4g} t/h" if mass is not None else scale
        yield Number("flow rate of bulk", flow_text(field["flow_rate_m3_per_s"]), note)
    errors = {name: record["figures"].get("statistical_error", {}) for name, record in _records(provenance)}
    for name, error in errors.items():
        if "whole" in error:
            sections = {section: value for section, value in error.items() if section != "whole"}
            worst = max(sections, key=lambda one: sections[one], default="")
            note = f"worst section {worst}: {_percent(sections[worst])}" if worst else ""
            yield Number(f"statistical error{_of(name)}", _percent(error["whole"]), note)
    if not any(errors.values()):
        if plan is not None and plan["model"] == "fluid":
            yield Number("statistical error", "none", "a fluid has no noise; its error is that of the model")
        else:
            yield Number("statistical error", "not known", "too few segments were averaged, or the method tells none")
    if "largest_speed_m_per_s" in field:
        yield Number("largest velocity", _speed(field["largest_speed_m_per_s"]), "of the bulk")
    if "reference_packing" in field:
        yield Number("reference packing φ_ref", f"{field['reference_packing']:.3f}", "solids in the flowing bulk")
    if "reference_density_kg_per_m3" in field:
        yield Number("reference density ρ_ref", f"{field['reference_density_kg_per_m3']:.4g} kg/m³", "= ρ_s φ_ref")
    for name, record in _records(provenance):
        measured = record["figures"]
        if "particles" in measured:
            counts = measured["particles"]  # of each replica; of dumps there is one
            told = " + ".join(
                f"{one:,}".replace(",", "\u202f") for one in (counts if isinstance(counts, list) else [counts])
            )
            yield Number(f"particles{_of(name)}", told, "at the end" if plan is not None else "in the dumps")
        if turnovers := measured.get("turnovers"):
            least = min(turnovers, key=lambda one: turnovers[one])
            note = f"times during the average, section {least}"
            yield Number(f"least turnover{_of(name)}", f"{turnovers[least]:.2g}", note)
    if "wall_seconds" in provenance:
        produced = sum(sum(record["figures"].get("produce_wall_seconds", ())) for _, record in _records(provenance))
        note = f"production took {duration_text(produced)}" if produced else ""
        yield Number("time of this run", duration_text(provenance["wall_seconds"]), note)


def _of(name: str) -> str:
    return f", sub-model {name}" if name else ""


def _speed(value: float) -> str:
    unit, factor = readable_unit(value)
    return f"{value * factor:.3g} {unit}"


def _sections(folder: Path, plan: Data | None, provenance: Data) -> Iterator[Section]:
    figures = folder / "figures"
    yield from _pictures(figures, plan, provenance)
    yield from _profiles(figures, provenance)
    yield from _by_section(plan, provenance)
    yield from _flow(figures)
    yield from _not_fit(plan, provenance)
    yield _gates(provenance)
    if plan is not None:
        yield from _settings(plan, provenance)
    yield from _files(folder)
    if (folder / "comsol" / "import_comsol.java").exists():
        slab = "depth_m" in provenance.get("field", {})
        steps = [SLAB_STEPS.get(number, step) for number, step in enumerate(COMSOL_STEPS) if slab] or COMSOL_STEPS
        yield Section("Use it in COMSOL", items=steps, numbered=True)
    yield _citation(provenance)
    yield _versions(provenance)


def _pictures(folder: Path, plan: Data | None, provenance: Data) -> Iterator[Section]:
    case = provenance["case"]
    scale = "at the flow rate of the process" if case else "at the scale of the dumps"
    slab = "depth_m" in provenance.get("field", {})
    section = "the section of the slab" if slab else "half of the section through the axis"
    panels = PANELS | (_SLAB_PANELS if slab else {})
    shown = [
        Picture(path, f"{title}. {text}", f"{title} in {section}.")
        for name, (title, text) in panels.items()
        if (path := folder / f"rz_{name}.png").exists()
    ]
    if shown:
        text = [f"{section[0].upper()}{section[1:]}, {scale}. Sections are named at the right."]
        if plan is not None and plan["model"] == "hybrid":
            text.append("Where the fluid flows alone, no standard error is known: it is drawn as 0.")
        yield Section("The flow", text, shown, narrow=True)
    if (path := folder / "space_w.png").exists():
        caption = (
            f"Vertical velocity on two upright cuts through the middle and on three levels, {scale}. Grey: no solids."
        )
        yield Section(
            "The flow", figures=[Picture(path, caption, "Vertical velocity on five cuts through the vessel.")]
        )
    vessels = sorted(folder.glob("vessel*.png"))
    if vessels:
        caption = (
            "Particles behind the cut at the end of the simulation, by vertical velocity, scaled to "
            "the flow rate of the process, and by radius. Red lines: inlet and outlet of your vessel, or of the "
            "part of it that was simulated; feeder above and room for the plate below belong to the simulation alone. "
            "Particles that fall in the feeder are off the scale."
        )
        alt = "The vessel cut open, with its particles coloured by vertical velocity and by radius."
        yield Section("The particles", figures=[Picture(path, caption, alt) for path in vessels])
    if (folder / "animation.gif").exists():
        yield Section(
            "Animation", rows=[[Link("animation.gif", "figures/animation.gif"), "layers of the bed as it flows"]]
        )


def _profiles(folder: Path, provenance: Data) -> Iterator[Section]:
    names = provenance.get("field", {}).get("sections", {})
    paths = [path for name in names if (path := folder / f"profile_{name}.png").exists()]
    if paths:
        bands = " Bands: 95 %, from the standard error." if (folder / "rz_error.png").exists() else ""
        text = f"Bulk velocity across the vessel, at mid-height of the sections.{bands}"
        shown = [
            Picture(path, alt=f"Vertical and radial velocity over the radius in section {path.stem[8:]}.")
            for path in paths
        ]
        yield Section("Profiles", [text], shown, narrow=True)


def _by_section(plan: Data | None, provenance: Data) -> Iterator[Section]:
    sections = provenance.get("field", {}).get("sections", {})
    if not sections:
        return
    fastest = max(one["largest_speed_m_per_s"] for one in sections.values())
    unit, factor = readable_unit(fastest)
    measured = [record["figures"] for _, record in _records(provenance)]
    largest = max(max(one["at_rest_m2"], one["void_m2"]) for one in sections.values())
    area, per_metre = ("cm²", 1e4) if 0 < largest < 0.01 else ("m²", 1.0)
    speeds = [f"mean velocity [{unit}]", f"largest velocity [{unit}]"]
    head = ["section", "z [m]", *speeds, f"at rest [{area}]", f"void [{area}]"]
    extra = {
        "error": lambda figures, name: _percent(figures["statistical_error"][name]),
        "turnover": lambda figures, name: f"{figures['turnovers'][name]:.2g}",
        "off-centre": lambda figures, name: _off_centre(figures["off_centre"][name]),
    }
    rows = []
    for name, one in sections.items():
        cells = [f"{one[key] * factor:.3g}" for key in ("mean_speed_m_per_s", "largest_speed_m_per_s")]
        cells += [f"{one[key] * per_metre:.2g}" for key in ("at_rest_m2", "void_m2")]
        row = [name, f"{one['z_m'][0]:g} to {one['z_m'][1]:g}", *cells]
        rows.append([*row, *(_first(measured, name, tell) for tell in extra.values())])
    kept = [k for k in range(len(head) + len(extra)) if k < len(head) or any(row[k] != "–" for row in rows)]
    head += list(extra)
    text = (
        "Velocities of the bulk; the mean is the flow rate over the mean area of the section. Areas are in the "
        "section that is drawn; at rest is what is slower than a fiftieth of the mean speed over the widest level."
    )
    meanings = {
        "error": "The error is the relative standard error.",
        "turnover": "Turnover is how often the content was renewed during the average.",
        "off-centre": "Off-centre is the part of the flow that differs round the axis, with its standard error.",
    }
    shown = [head[k] for k in kept]
    text = " ".join([text, *(meaning for name, meaning in meanings.items() if name in shown)])
    yield Section("By section", [text], head=shown, rows=[[row[k] for k in kept] for row in rows])


def _first(measured: Sequence[Data], name: str, tell: Any) -> str:
    """What the first record that knows a section tells of it."""
    for figures in measured:
        try:
            return str(tell(figures, name))
        except KeyError:
            continue
    return "–"


def _off_centre(found: Data) -> str:
    amplitude, error = max(zip(found["amplitudes"], found["amplitudes_se"], strict=True))
    return f"{100 * amplitude:.2g} ± {100 * error:.2g} %"


def _flow(folder: Path) -> Iterator[Section]:
    if (folder / "rz_flow.png").exists():
        text = (
            "Every level must carry the same flow. The plain average shows noise and what still gathers; "
            "the final field conserves."
        )
        alt = "Flow of solids through every level as a percentage of the reference, beside the vessel."
        yield Section("Flow through levels", [text], [Picture(folder / "rz_flow.png", alt=alt)])


def _not_fit(plan: Data | None, provenance: Data) -> Iterator[Section]:
    """What the field must not be used for, and what the run itself warned of."""
    model = plan["model"] if plan else ""
    limits = ["Filling, emptying, start and stop: the field is the average of a steady flow."]
    if provenance["case"]:
        limits.append(
            "Fast flow: velocities are scaled to the flow rate of the process, which holds while the flow is too "
            "slow for inertia not to matter."
        )
    if model != "fluid":
        limits.append(
            "Motion of single particles, mixing by their random motion, segregation: the field is an average."
        )
        limits += _one_way(provenance.get("field", {}), in_space(provenance["figures"]))
    elif plan is not None and _is_frictional(plan, provenance):
        limits.append(
            "Arching, flow in jerks and the history of filling: a fluid with friction knows none of them. Above a "
            "floor its funnel is too wide."
        )
    else:
        limits.append("Stagnant zones and free surfaces: a fluid fills the vessel and moves everywhere.")
    voids = sum(one["void_m2"] for one in provenance.get("field", {}).get("sections", {}).values())
    if voids:
        limits.append(
            f"Transport across voids ({voids:.2g} m² of the half section): no solids move there; "
            "heat or gas that crosses them needs a model of its own."
        )
    yield Section("What the field is not fit for", items=limits)
    if told := _told(plan, provenance):
        yield Section("Keep in mind", items=told)


def in_space(figures: Data) -> bool:
    """Whether a run's figures are those of a field in space: of such a one alone they tell what conserving changed."""
    return "conserving_changes" in figures


def _one_way(field: Data, spatial: bool) -> list[str]:
    """What the field does not know, for it is a mean along one coordinate; nothing of one in space."""
    if spatial:
        return []
    if field.get("front_and_back_walls"):
        return [
            "Flow that differs along the depth: the field is the mean over it. Solids are slower at the front and the "
            "back wall, so that paths and times that follow from it are none of the solids' own."
        ]
    if "depth_m" in field:
        return [
            "Flow that differs along the depth, and front and back walls: the field is that of a slab which is alike "
            "all along it."
        ]
    return ["Flow that differs round the axis: the field is the average over the full turn."]


def _gates(provenance: Data) -> Section:
    gates = [
        (gate["name"], f"{gate['value']:.3g}", gate["limit"], "passed" if gate["passed"] else "FAILED")
        for gate in provenance["quality"]
    ]
    return Section("Quality gates", head=("gate", "value", "must be", "result"), rows=gates)


def _settings(plan: Data, provenance: Data) -> Iterator[Section]:
    yield from _dem_sections(plan, provenance)
    for name, submodel in provenance.get("submodels", {}).items():
        yield from _dem_sections(plan["submodels"].get(name, {}), submodel, f" of sub-model {name}")
    if plan.get("wall_factors"):
        rows = [(one["name"], one["value"], one["criterion"]) for one in plan["wall_factors"]]
        yield Section("Wall factors", head=("section", "value", "criterion"), rows=rows)
    stages = [(stage["stage"], stage["reason"]) for stage in plan["stages"]]
    yield Section("What was done", head=("stage", "why"), rows=stages)
    left_out = [(one["what"], one["reason"]) for one in plan.get("left_out", ())]
    if left_out:
        yield Section("What was left out", head=("what", "why"), rows=left_out)
    times = [
        ("forecast of filling and production", duration_text(provenance["forecast_seconds"])),
        ("this run, total", duration_text(provenance["wall_seconds"])),
    ]
    yield Section("Time", head=("what", "time"), rows=times)


def _dem_sections(plan: Data, record: Data, whose: str = "") -> Iterator[Section]:
    """Settings, bulk and times of a DEM run: that of the whole vessel, or that of a sub-model."""
    figures = record["figures"]
    if whose and (errors := figures.get("statistical_error")):
        rows = [(name, _percent(error)) for name, error in errors.items()]
        yield Section(f"Statistical error{whose}", head=("section", "relative error"), rows=rows)
    decisions = [(c["name"], c["value"], c["criterion"]) for c in plan.get("dem", {}).get("decisions", ())]
    if decisions:
        seeds = ", ".join(map(str, record.get("seeds", ())))
        text = [f"Seeds: {seeds}."] if seeds else []
        yield Section(f"Settings and criteria{whose}", text, head=("setting", "value", "criterion"), rows=decisions)
    if "overlap_correction" in figures:
        yield Section(f"Bulk{whose}", [BULK_TEXT], head=("what", "value"), rows=_bulk(figures))
    if "discharge" in figures:
        yield Section(f"Free discharge{whose}", head=("what", "kg/s"), rows=_discharge(figures["discharge"]))
    if "produce_wall_seconds" in figures:
        yield Section(f"Production{whose}", head=("what", "time"), rows=_times(figures))


def _bulk(figures: Data) -> list[tuple[str, str]]:
    return [
        ("reference packing", f"{figures['bulk_packing']:.4f}"),
        ("reference density", f"{figures['bulk_density_kg_per_m3']:.5g} kg/m³"),
        ("mean overlap, of a diameter", f"{figures['reference_overlap']:.2%}"),
        ("correction for it", f"{figures['overlap_correction']:.4f}"),
    ]


def _discharge(figures: Mapping[str, float | None]) -> list[tuple[str, str]]:
    named = {
        "through the outlet, averaged": figures["kg_per_s"],
        "its standard error": figures["standard_error"],
        "LIGGGHTS' own counter": figures["counted_kg_per_s"],
    }
    return [(name, f"{value:.4g}") for name, value in named.items() if value is not None]


def _times(figures: Data) -> list[tuple[str, str]]:
    """What the stages took; those that were done before took it in an earlier run."""
    return [
        ("production, each run", ", ".join(map(duration_text, figures["produce_wall_seconds"]))),
        ("of which averaging", ", ".join(map(duration_text, figures["averaging_seconds"]))),
    ]


def _files(folder: Path) -> Iterator[Section]:
    paths = [
        path.relative_to(folder)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.startswith(".") and path.name not in ("report.html", "manifest.json")
    ]
    shown = [path for path in paths if path.parts[0] not in ("figures", "logs")]
    rows: list[list[str | Link]] = [
        [Link(path.as_posix(), path.as_posix()), FILES.get(path.name, PROGRAMS.get(path.parts[0], ""))]
        for path in shown
    ]
    for name, what in (("figures", "the pictures"), ("logs", "what LIGGGHTS said")):
        if any(path.parts[0] == name for path in paths):
            rows.append([Link(f"{name}/", f"{name}/"), what])
    text = ["The links lead to files beside this page: they work where it lies in its folder."]
    yield Section("Files", text, head=("file", "what it holds"), rows=rows)


def _citation(provenance: Data) -> Section:
    program, article = CITATION
    version = provenance["granpipe"]
    return Section(
        "How to cite",
        items=[
            f"the granpipe authors, {program}, version {version}, MIT licence.",
            f"M. Sparta and S. A. Halvorsen (2017), {article}.",
        ],
    )


def _versions(provenance: Data) -> Section:
    rows = [("granpipe", provenance["granpipe"]), *provenance.get("versions", {}).items()]
    return Section("Versions", head=("program", "version"), rows=rows)
