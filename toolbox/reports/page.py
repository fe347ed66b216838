"""The report of a run: result in words, warnings, map, view in space, tables, how it was made."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from toolbox import language
from toolbox.data import Figure, Raster, Report, Rows, Section, Table
from toolbox.data.crs import Unit
from toolbox.data.layer import Layer
from toolbox.data.report import Block, Column, Head, Plot
from toolbox.declare.fields import Field, Spec
from toolbox.pictures.draw import drawable, png
from toolbox.reports import counted, words
from toolbox.reports.counted import Cells
from toolbox.reports.facts import chosen_settings, facts_of, in_place_of, layers_of
from toolbox.reports.maps import DRAWING, maps_of
from toolbox.reports.space import space_of
from toolbox.reports.units import drawn_in, in_both, in_unit, unit_of_data

if TYPE_CHECKING:
    from toolbox.runs.provenance import Record


_NAME = "Name in the program"  # of a setting
_MOST_INPUTS = 12  # files that are named on paper
STRIP = 4  # times as long as wide, a map shows little


@dataclass
class Told:
    """What a run tells beside its results.

    Attributes
    ----------
    given : the layers that were read, by name of the source
    warnings : in the order of the run
    words : steps that say their result in words, and what they say
    unseen : what was not looked at
    thinned : few enough points and cells of results and sources that are too large to be in
        memory, by name; they are drawn, and nothing is counted in them
    cells, by_class : what is told of these, counted in all of their cells and points
    files : names of the files that results are written to
    of_set : settings that the set to hand over has of itself, as nobody gave them
    """

    given: Mapping[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    words: list[tuple[str, str]] = field(default_factory=list)
    unseen: list[str] = field(default_factory=list)
    thinned: Mapping[str, Layer] = field(default_factory=dict)
    cells: Mapping[str, Cells] = field(default_factory=dict)
    by_class: Mapping[str, Counter[int]] = field(default_factory=dict)
    files: dict[str, str] = field(default_factory=dict)
    of_set: frozenset[str] = frozenset()


def page(
    spec: Spec, found: Mapping[str, Any], record: Record | None, told: Told | None = None
) -> Report:
    """The report of a run.

    Parameters
    ----------
    spec : of the tool
    found : what it gave, by name
    record : how that was made
    told : what else the run has told
    """
    told = told or Told()
    reports = [value for value in found.values() if isinstance(value, Report)]
    layers = _layers(spec, found)
    drawn = {**found, **{n: layer for n, layer in told.thinned.items() if n in spec.results}}
    below = {**told.given, **{n: v for n, v in told.thinned.items() if n in spec.sources}}
    plots = [Section(title, [plot]) for title, plot in maps_of(spec, drawn, below)]
    if view := space_of(spec, drawn, below):
        plots.insert(1, Section("3-D view", [view]))
    own = [section for report in reports for section in report.sections]
    listed = {b.layer for section in own for b in section.blocks if isinstance(b, Rows)}
    every = layers_of(told.given, found)
    unit = unit_of_data(every)
    sections = [
        *(in_order(plots) or _pictures(found, spec)),
        *own,
        *_counted(spec, layers, told),
        *_charts(found, spec, unit),
        *_results(spec, found, unit),
        *(
            section
            for name, layer in layers.items()
            if name not in listed and not isinstance(layer, Report) and layer.size() != 0
            for section in _of_layer(spec.results[name], layer)
        ),
        *_sizes(spec, layers),
        *_settings(spec, record, unit),
        *_made(spec, record, every, told.of_set),
    ]
    summary, head = said(spec, found, record, told)
    return Report(spec.title, in_unit(sections, unit), summary=summary, head=head, name=spec.id)


def said(
    spec: Spec, found: Mapping[str, Any], record: Record | None, told: Told
) -> tuple[str, Head]:
    """What a run says in words: its result, and the head of a report with facts and warnings.

    The result is one paragraph. A report among the results sums up all of them; else the steps say
    theirs one by one. What a warning says is not said once more.
    """
    unit = unit_of_data(layers_of(told.given, found))
    reports = [value for value in found.values() if isinstance(value, Report)]
    summaries = [report.summary for report in reports if report.summary]
    rasters = counted.in_words(spec, _cells(found, told), told.files) if spec.between else ""
    steps = _in_order_of_results(spec, told.words)
    first = next(iter(spec.outputs.values()), None)  # of terrain models a raster, of lakes a curve
    own = [rasters, *steps] if first and first.kind.is_gridded else [*steps, rasters]
    texts = summaries or own
    summary = "\n".join(filter(None, texts)) or words.generic(spec, found)
    unseen = [
        *_given_up(spec, found, told),
        *told.unseen,
        *(text for report in reports for text in report.head.unseen),
    ]
    facts = facts_of(spec, found, record, told.given, told.of_set)
    head = _head(facts, told.warnings, unseen, unit)
    warned = {text.rstrip(".").casefold() for text in head.warnings}
    lines = [in_both(line, unit) for line in summary.splitlines()]
    return " ".join(line for line in lines if line.rstrip(".").casefold() not in warned), head


def _in_order_of_results(spec: Spec, told: Sequence[tuple[str, str]]) -> list[str]:
    """What the steps of a model say: first those whose results are the first among its own.

    Those that only prepare others come last, in the order of the run. Of these, one whose points
    are classified anew by a later step says nothing.
    """
    named = [name for linked in getattr(spec, "returns", {}).values() for name in linked.names]
    steps = [name.partition(".")[0] for name in named]
    points = [name for name in named if spec.between[name].kind.word == "PointCloud"]
    anew = {name.partition(".")[2] for name in points}
    places = {step: place for place, step in reversed(list(enumerate(steps)))}
    last = [
        (step, text)
        for step, text in told
        if step in places or not any(f"{step}.{output}" in spec.between for output in anew)
    ]
    return [text for _, text in sorted(last, key=lambda one: places.get(one[0], len(steps)))]


def framed(report: Report, spec: Spec, record: Record | None, told: Told | None) -> Report:
    """The report that a tool has made, with the facts and the warnings of the run in its head.

    It is the same whether the run was in tiles or not, as it shows none of the other results.
    """
    given = layers_of(told.given if told else {}, {})
    unit = unit_of_data(given)
    of_set = told.of_set if told else frozenset()
    facts = facts_of(spec, {}, record, {}, of_set)
    head = _head(facts, told.warnings if told else (), report.head.unseen, unit)
    sections = [*report.sections, *_settings(spec, record, unit)]
    sections += _made(spec, record, given, of_set)
    summary = "\n".join(in_both(line, unit) for line in report.summary.splitlines())
    shown = in_unit(sections, unit)
    return Report(report.title, shown, summary=summary, head=head, name=report.name)


def in_order(plots: Sequence[Section]) -> list[Section]:
    """The plots of a report; a map that is a strip, as of a front from above, after drawings."""
    first = next((block for part in plots[:1] for block in part.blocks), None)
    drawn = any(part.title.startswith(DRAWING) for part in plots)
    if drawn and isinstance(first, Plot):
        west, south, east, north = first.data["bounds"]
        sides = sorted((east - west, north - south))
        if sides[1] > STRIP * sides[0]:
            return [*plots[1:], plots[0]]
    return list(plots)


def _head(
    facts: Sequence[tuple[str, str]],
    warnings: Sequence[str],
    unseen: Sequence[str],
    unit: Unit | None,
) -> Head:
    """The head of a report; what a warning says is not said once more of what was not looked at."""
    warned = _once(warnings)
    begun = tuple(text.rstrip(".").casefold() for text in warned)
    others = [text for text in _once(unseen) if not text.casefold().startswith(begun)]
    said = [[in_both(text, unit) for text in texts] for texts in (warned, others)]
    return Head(facts, said[0], said[1])


def _once(texts: Sequence[str]) -> tuple[str, ...]:
    """Texts for others, each once: where files lie on this computer is nobody's business."""
    return tuple(dict.fromkeys(map(words.without_folders, texts)))


def _results(spec: Spec, found: Mapping[str, Any], unit: Unit | None) -> list[Section]:
    """Section with a row for each number or text among the results, exact if told in a unit."""
    rows = []
    for name, value in found.items():
        field = spec.results[name]
        if value is not None and not field.kind.is_layer:
            shown, word = words.result_value(value, field.unit, field.help, exact=bool(unit))
            rows.append({"Result": field.help, "Value": shown, "Unit": word})
    if all(row["Unit"] in ("", "1") for row in rows):  # as counts have none
        rows = [{"Result": row["Result"], "Value": row["Value"]} for row in rows]
    return [Section("Results", [Rows(Table.from_rows(rows), short=len(rows))])] if rows else []


def _layers(spec: Spec, found: Mapping[str, Any]) -> dict[str, Layer]:
    """The single layers among the results by name, without tuples of repeated steps."""
    return {
        name: value
        for name, value in found.items()
        if spec.results[name].kind.is_layer and not (value is None or isinstance(value, tuple))
    }


def _counted(spec: Spec, layers: Mapping[str, Layer], told: Told) -> list[Section]:
    """The sections with figures of rasters, and of points by class, in memory or in tiles."""
    cells = _cells(layers, told)
    points = _points(layers, told)
    after = {n: points[n] for n in spec.results if n in points}
    before = next((points[n] for n in spec.sources if n in points), Counter[int]())
    rasters = counted.rasters(spec, {n: cells[n] for n in spec.results if n in cells}, told.files)
    return [*rasters, *counted.classes(spec, after, before)]


def _points(found: Mapping[str, Any], told: Told) -> dict[str, Counter[int]]:
    """The points of each class of the clouds of a run, those that were given too."""
    clouds = [*found.items(), *told.given.items()]
    return {n: counts for n, x in clouds if (counts := counted.by_class(x))} | {**told.by_class}


def _given_up(spec: Spec, found: Mapping[str, Any], told: Told) -> Iterator[str]:
    """What is said of classes of the input that the classified points do not have."""
    points = _points(found, told)
    before = next((n for n in spec.sources if n in points), None)
    made = found.keys() | told.by_class.keys()
    after = next((n for n in spec.results if n in points and n in made), None)
    if before and after:
        became = counted.became(told.given.get(before), found.get(after))
        yield from counted.given_up(points[before], points[after], became)


def _cells(layers: Mapping[str, Any], told: Told) -> dict[str, Cells]:
    """The figures of rasters, in memory or of tiles."""
    held = {n: Cells.of(x) for n, x in layers.items() if isinstance(x, Raster)}
    return {**held, **told.cells}


def _of_layer(declared: Field, layer: Layer) -> Iterator[Section]:
    """The sections that list what is in a layer, whose rows are found on the map."""
    title = words.titled(declared)
    columns = words.columns_in(declared.columns, layer)
    for section in layer.page_sections(title, declared.help, columns):
        blocks: list[Block] = [
            replace(block, layer=words.anchor_of(declared.name))
            if isinstance(block, Rows) and layer.is_spatial
            else block
            for block in section.blocks
        ]
        folded = section.folded or not declared.listed
        yield Section(section.title, blocks, folded, None if declared.listed else _short(blocks))


def _short(blocks: Sequence[Block]) -> list[Block]:
    """What stands on paper for tables that are listed nowhere else: long ones are counted."""
    return [
        f"{block.caption}: {len(block.table)} rows, which are on the page for browsers and in the "
        "files."
        if isinstance(block, Rows) and not block.is_short
        else block
        for block in blocks
    ]


def _pictures(found: Mapping[str, Any], spec: Spec) -> list[Section]:
    """A picture of what cannot be put on a map."""
    layers = {n: s for n, s in drawable(found, spec.results).items() if not isinstance(s[0], Table)}
    if not layers:
        return []
    names = ", ".join(words.titled(spec.results[name]) for name in layers)
    return [Section("Picture", [Figure(png(layers), names)])]


def _charts(found: Mapping[str, Any], spec: Spec, unit: Unit | None) -> list[Section]:
    """The tables that are shown as charts."""
    charts = {n: s for n, s in drawable(found, spec.results).items() if isinstance(s[0], Table)}
    return [
        Section(
            f"Chart: {words.titled(spec.results[name])}",
            [Figure(png({words.titled(spec.results[name]): drawn_in(*shown, unit)}), help)],
        )
        for name, shown in charts.items()
        for help in [spec.results[name].help if name in spec.results else name]
    ]


def _sizes(spec: Spec, layers: Mapping[str, Layer]) -> list[Section]:
    """Section with the size of each layer that is not listed."""
    rows = [
        {
            "Layer": words.titled(spec.results[name]),
            "Holds": spec.results[name].help,
            "Size": layer.size_text(),
        }
        for name, layer in layers.items()
        if layer.size_text() and not isinstance(layer, Raster)
    ]
    return [Section("Layers", [Rows(Table.from_rows(rows))], folded=True)] if rows else []


def _settings(spec: Spec, record: Record | None, unit: Unit | None) -> list[Section]:
    """Section with all settings; lengths that are round in the unit of the data are told in it.

    On paper without their names in the program, which who runs it again needs.
    """
    if record is None:
        return []
    rows = []
    for name, said in spec.inputs.items():
        if name in record.parameters:
            value, of = words.setting_in(said, record.parameters[name], unit)
            if other := in_place_of(name, record):
                value, of = f"not used: {spec.inputs[other].title} is given in its place", ""
            row = {"Setting": said.title, "Meaning": said.help, "Value": value, "Unit": of}
            rows.append({**row, _NAME: name})
    if not rows:
        return []
    table = Table.from_rows(rows)
    block = Rows(table, columns={_NAME: Column(_NAME, as_is=True)})
    printed = Rows(Table(table.frame.drop(columns=_NAME)))
    return [Section("Settings", [block], folded=True, printed=[printed])]


def _made(
    spec: Spec, record: Record | None, layers: Sequence[Layer], of_set: Collection[str]
) -> list[Section]:
    """Section with the whole record; on paper with what identifies tool and inputs alone."""
    if record is None:
        return []
    files = [
        {
            "Input": words.title_of(name),
            "File": item.file + (f" ({item.files} files)" if item.files > 1 else ""),
            "Bytes": item.bytes,
            "SHA-256": item.sha256,
        }
        for name, items in record.inputs.items()
        for item in items
    ]
    chosen = chosen_settings(spec, record, layers, of_set) or "none"
    text = (
        f"{spec.title} ({spec.id}), lidar-toolbox {record.version}. Settings other than the "
        f"defaults: {chosen}. The sizes of all steps are on the page for browsers, and in the "
        "record that the files carry."
    )
    printed: list[Block] = [text]
    if files:
        printed.append(Rows(Table.from_rows(files), most=_MOST_INPUTS))
    # The first line of a record names the file, whose words are those of the program.
    body = record.text().partition("\n")[2]
    whole = f"{language.text(spec.title)} ({spec.id})\n{body}"
    return [Section("How it was made", [whole], folded=True, printed=printed)]


def told_by(spec: Spec, result: Any) -> tuple[Sequence[str], Sequence[str]]:
    """What the outputs of a tool say in words, and what was not looked at; see `outputs`."""
    declared = getattr(spec.make, "Outputs", None)
    said = getattr(declared, "in_words", None)
    unseen = getattr(declared, "not_looked_at", None)
    return ([said(result)] if said else []), (list(unseen(result)) if unseen else [])
