"""Makes the list of tools for the QGIS plugin, tools.json, from the declarations.

The plugin knows no tool and no type of ours. The list says for each input and output which widget
it needs, so QGIS shows all tools without starting another Python.
"""

from __future__ import annotations

import html
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from toolbox import __version__, catalog, language
from toolbox.context import log
from toolbox.data import Raster, Report, Table
from toolbox.data.paths import READABLE, VPC
from toolbox.data.report.columns import COMMON, Column
from toolbox.declare.fields import Field, Spec
from toolbox.declare.kinds import CHOICE, find
from toolbox.declare.show import Classes, Isolines, OfClass, Texts
from toolbox.errors import ParameterError
from toolbox.labels import in_words
from toolbox.models.model import Model
from toolbox.pictures.images import CHANGES, GREY, NO_HEIGHTS, OTHER, POINT_CLASSES, RELIEF
from toolbox.reports.words import is_share
from toolbox.shown import DELIVER, README

PROVIDER = "lidartoolbox"
TILES = ("auto", "100", "250", "500", "1000")  # metres, offered beside any other
MEMORY = ("1GB", "2GB", "4GB", "8GB", "16GB")
SCHEMA = 1  # version of the list; the plugin refuses any other
LAYERS = {"PointCloud": "pointcloud", "Raster": "raster", "Vector": "vector", "Table": "table"}
SCALARS = {"number", "integer", "boolean", "range", "extent", "position", "CRS"}
WIDGETS = {"class list": "classes", "file": "file", "expression": "condition"}
SEPARATOR = ";"  # between several values in one text
TAGS = ("lidar", "las", "laz", "point cloud")
ASSUME_CRS = "assume_crs"
GRID = find(Raster)
SHOWN_OF_SET = (".tif", ".gpkg", ".laz")  # files of the set that is handed over
LOOKS = ("classes", "colour", "isolines", "texts", "columns")  # how a layer is shown
MEASURED = {"m": 3, "unit": 3, "°": 3, "m²": 2, "unit²": 2, "m³": 1}  # digits, as of rounded files
LONGEST = 60  # letters of a heading in a table; a meaning that is longer is none
SHOWN_AT_ONCE = 12  # inputs of a dialog; optional ones after these are "advanced"


def listing() -> dict[str, Any]:
    """All tools and models, and the colours of their results."""
    return {
        "schema": SCHEMA,
        "toolbox": __version__,
        "colours": _colours(),
        "tools": [tool(spec) for spec in _specs(catalog.ids())],
    }


def algorithm(id: str) -> str:
    """The name of a tool in QGIS: letters and digits alone.

    >>> algorithm("points.height_above_ground")
    'pointsheightaboveground'
    """
    return re.sub(r"[^a-z0-9]", "", id.lower())


def names() -> dict[str, str]:
    """The id of each tool by its name in QGIS."""
    return {algorithm(id): id for id in catalog.ids()}


def _specs(ids: Iterable[str]) -> Iterator[Spec]:
    for id in ids:
        try:
            yield catalog.load(id)
        except ParameterError as err:  # a tool of another package
            log.warning("%s is left out: %s", id, err)


def _colours() -> dict[str, Any]:
    """How layers are shown: the colours of our own plots, and what many columns are called."""
    return {
        "classification": [[code, *look] for code, look in POINT_CLASSES.items()],
        "relief": list(RELIEF),
        "other": list(OTHER),
        "columns": _columns(COMMON),
        "bands": {"grey": list(GREY), "changes": list(CHANGES), "no_heights": list(NO_HEIGHTS)},
    }


def tool(spec: Spec) -> dict[str, Any]:
    """The entry of one tool."""
    return {
        "id": spec.id,
        "algorithm": algorithm(spec.id),
        "title": language.text(spec.title),
        "group": language.text(spec.group),
        "group_id": algorithm(spec.id.partition(".")[0]),
        "summary": f"{language.text(spec.summary or spec.title)}.",
        "help": help_page(spec),
        "tags": _tags(spec),
        "inputs": _inputs(spec),
        "outputs": [*_results(spec), *_set(spec), *_shown()],
    }


def _tags(spec: Spec) -> list[str]:
    """What a search finds a tool by: also the names of its layers and of what it hands over."""
    layers = [name for name, f in _fields(spec).items() if f.kind.is_layer]
    named = " ".join([*layers, *(one.file.partition(".")[0] for one in spec.deliver)])
    words = re.findall(r"[a-z]{3,}", f"{spec.id} {spec.title} {spec.summary} {named}".lower())
    return list(dict.fromkeys([*TAGS, spec.id, *spec.tags, *words]))


def _fields(spec: Spec) -> dict[str, Field]:
    return {**spec.inputs, **spec.outputs}


def _inputs(spec: Spec) -> list[dict[str, Any]]:
    made = [field(f) | _offered_of(f, spec) for f in spec.inputs.values()]
    made = [f | {"advanced": n >= SHOWN_AT_ONCE and not f["required"]} for n, f in enumerate(made)]
    options = [*general(spec), *_head(spec)]
    crs = [f for f in options if f["name"] == ASSUME_CRS]
    after = 1 + next((n for n, f in enumerate(made) if f["type"] in LAYERS.values()), -1)
    return [*made[:after], *crs, *made[after:], *(f for f in options if f not in crs)]


def _offered_of(f: Field, spec: Spec) -> dict[str, list[str]]:
    """The layers whose attributes or bands the dialog offers: the one stated, or else the first.

    One that may be left out has others in its place, so these are offered, too.
    """
    first = next(iter(spec.sources)) if f.kind.word == "attribute" else None
    name = f.of or first
    if name is None or f.role != "param":
        return {}
    others = [
        n for n, source in spec.sources.items() if source.optional and source.kind is not GRID
    ]
    return {"of": [name, *(n for n in others if n != name and spec.sources[name].optional)]}


def field(f: Field) -> dict[str, Any]:
    """The entry of one input or output: its widget, and the rules of its values."""
    label = language.text(f.title)
    feet = f"{f.feet:g} ft for data in feet while the box has its default" if f.feet else ""
    help = "; ".join(filter(None, (language.text(f.help), language.told(feet))))
    made: dict[str, Any] = {"name": f.name, "type": _type(f), "help": help}
    asked = f.role != "sink" and made["type"] == "length"  # whose box has the unit beside it
    if f.unit and f.unit != "1" and not asked:
        label += f" [{f.unit}]"
    made |= {"label": label, "many": f.many}
    if f.role == "sink":
        made |= {"share": True} if is_share(1.0, f.unit, f.help) else {}
        made |= {"suffixes": list(f.suffixes)} if f.kind.is_layer else {}
        made |= {"columns": _columns(f.columns)} if f.columns else {}
        return made | _shown_as(f)
    offers = f.offers or (f.choices if f.kind is not CHOICE else ())
    made |= {"offers": list(map(str, offers))} if offers else {}
    if made["type"] == "classes":
        made["known"] = [[code, name] for code, (name, _) in POINT_CLASSES.items()]
    made |= {"reads": [*READABLE, VPC]} if made["type"] == "pointcloud" else {}
    made |= {"shapes": list(f.shapes)} if f.shapes else {}
    made |= {
        "required": f.required,
        "nullable": f.optional,
        "rule": language.told(f.rule()),
        **f.limits,
    }
    if f.kind is CHOICE:
        made["choices"] = [str(choice) for choice in f.choices]
        made["words"] = [language.text(f.choice_title(choice)) for choice in f.choices]
    if f.role == "param" and not f.required and f.default is not None:
        made["default"] = _default(f)
    return made


def _type(f: Field) -> str:
    """The name of the widget in the plugin."""
    if f.kind.is_layer:
        if f.kind.word == "Survey" and f.role == "source":
            return LAYERS["PointCloud"]
        return LAYERS.get(f.kind.word, "file")
    if f.kind is CHOICE:
        return "choice"
    if f.kind.word in WIDGETS and not f.many:
        return WIDGETS[f.kind.word]
    if f.kind.word not in SCALARS or f.choices or (f.many and f.role == "param"):
        return "text"
    return "length" if f.unit == "m" and f.kind.word == "number" else f.kind.word.lower()


def _shown_as(f: Field) -> dict[str, Any]:
    """How an output is drawn, as far as QGIS can: in colours, as isolines or as texts."""
    for show in f.show:
        match show:
            case Classes():
                looks = [[value, *look] for value, look in show.looks.items()]
                return {"classes": {"attribute": show.attribute, "looks": looks}}
            case OfClass():
                return {"colour": show.colour}
            case Isolines():
                return {"isolines": {"attribute": show.attribute, "heavy": show.heavy}}
            case Texts():
                return {"texts": {"text": show.text, "angle": show.angle}}
    return {}


def _columns(columns: Mapping[str, Column]) -> dict[str, Any]:
    """Heading, unit and digits of columns by name, for the numbers as files hold them."""
    told = {}
    for name, column in columns.items():
        heading = language.told(column.heading or column.meaning)
        more = round(math.log10(column.factor))  # a share in percent is one of 1 in the file
        digits = MEASURED.get(column.unit) if column.digits is None else column.digits + more
        unit = column.unit if column.factor == 1 else ""
        told[name] = [heading if len(heading) <= LONGEST else "", unit, digits]
    return told


def _default(f: Field) -> Any:
    """The default as the plugin shows it: words and several values as one text."""
    values = [v if v in f.choices else f.kind.to_json(v) for v in f.items(f.default)]
    if f.kind is CHOICE:
        return [str(v) for v in values] if f.many else str(values[0])
    if _type(f) in ("text", "classes"):
        texts = (",".join(map(str, v)) if isinstance(v, list) else str(v) for v in values)
        return SEPARATOR.join(texts)
    return values[0]


# What every run takes and gives ------------------------------------------------------------------


def general(spec: Spec) -> list[dict[str, Any]]:
    """The options of a run, as on the command line, for tools that read layers."""
    kinds = {f.kind.word for f in spec.sources.values()}
    made = []
    if kinds:
        says = language.text(
            "CRS of files that state none; one that states another keeps it. A scan in a place of "
            "its own has none: local (metres), local:mm, local:cm or local:ft"
        )
        label = language.text("CRS, if the file states none")
        made.append(_option(ASSUME_CRS, label, "crs", says))
        made[-1]["advanced"] = False
    if "PointCloud" in kinds:
        says = language.text(
            "Work in tiles of this size in metres, or auto, so that a survey need not fit in memory"
        )
        made.append(
            _option("tile", language.text("Tile size [m]"), "text", says) | {"offers": list(TILES)}
        )
        says = language.text("Processes that work on tiles")
        made.append(_option("workers", language.text("Workers"), "integer", says, ge=1))
        says = language.text("Memory that all workers may use together, such as 4GB")
        made.append(_option("memory", language.text("Memory of all workers"), "text", says))
        made[-1]["offers"] = list(MEMORY)
        says = language.text(
            "Keep what is done, and take over what an earlier run has kept, unless it changed"
        )
        made.append(
            _option("resume", language.text("Resume"), "boolean", says) | {"default": False}
        )
    return made


def _head(spec: Spec) -> list[dict[str, Any]]:
    """What reports say at their head; in front where a set with a report is handed over."""
    title = language.text(
        "Of the report, and of the set that is handed over; else that of the tool"
    )
    client = language.text("For whom the report is made")
    made = [
        _option("title", language.text("Title of the report"), "text", title),
        _option("client", language.text("Client of the report"), "text", client),
    ]
    return [one | {"advanced": not spec.deliver} for one in made]


def _option(name: str, label: str, type: str, help: str, **limits: float) -> dict[str, Any]:
    made: dict[str, Any] = {"name": name, "label": label, "type": type, "help": help}
    rule = " and ".join(f">= {limit:g}" for limit in limits.values())
    made |= {"option": name, "advanced": True}
    return made | {"many": False, "required": False, "nullable": True, "rule": rule, **limits}


def _file(name: str, label: str, help: str, suffixes: tuple[str, ...]) -> dict[str, Any]:
    made: dict[str, Any] = {"name": name, "label": label, "type": "file", "help": help}
    made |= {"option": name, "advanced": True}
    return made | {"many": False, "suffixes": list(suffixes)}


def _shown() -> list[dict[str, Any]]:
    """What every run can write of its results."""
    plot = language.text("Draw a plot of the resulting layers")
    page = language.text("Write a report of all results")
    counts = language.text("How much each step read and gave, as a table")
    return [
        _file("picture", language.text("Plot"), plot, (".png",)),
        _file("page", language.text("Report"), page, find(Report).suffixes),
        _file("counts", language.text("Counts"), counts, find(Table).suffixes),
    ]


def _results(spec: Spec) -> list[dict[str, Any]]:
    """The entries of the outputs; QGIS writes the first by default, or all of a model.

    Where that is points, which not every QGIS can show, the first of those that it can is written
    as well.
    """
    made = [field(f) for f in spec.outputs.values()]
    layers = [out for out in made if "suffixes" in out]
    seen = [out for out in layers if out["type"] in ("raster", "vector")]
    first = layers[:1]
    if first and first[0]["type"] == "pointcloud":
        first += seen[:1]
    for out in layers if isinstance(spec, Model) else first:
        out["first"] = True
    if isinstance(spec, Model):
        return [out | _made_if(spec, out["name"]) for out in made]
    return made


def _made_if(model: Model, output: str) -> dict[str, Any]:
    """The inputs without which no step of a model makes an output; nothing if one always does."""
    steps = (model.steps.get(name.partition(".")[0]) for name in model.returns[output].names)
    conditions = [step.when if step else None for step in steps]
    found = [{"input": c.name.partition(".")[2], "is": c.word} for c in conditions if c]
    return {"made_if": found} if len(found) == len(conditions) else {}


def _set(spec: Spec) -> list[dict[str, Any]]:
    """The folder of the set that is handed over, with the layers in it that QGIS shows."""
    if not spec.deliver:
        return []
    files = ", ".join(dict.fromkeys(one.file for one in spec.deliver))
    says = language.text("Write all that is handed over into this folder, completely or not at all")
    made: dict[str, Any] = {"name": DELIVER, "label": language.text("Folder to hand over")}
    made |= {"type": "folder", "help": f"{says}: {files}, {README}", "option": DELIVER}
    made |= {"many": False, "suffixes": [], "readme": README, "layers": _layers_of(spec)}
    decided = sorted(spec.handed) if isinstance(spec, Model) else []
    pages = (one.file for one in spec.deliver if one.file.endswith(".html"))
    return [made | {"report": next(pages, ""), "decided": decided}]


def _layers_of(spec: Spec) -> list[dict[str, Any]]:
    """The layers of the set, each once: no drawing or table, which QGIS need not show."""
    found: dict[str, dict[str, Any]] = {}
    for one in spec.deliver:
        if not (one.output in spec.results and one.file.endswith(SHOWN_OF_SET)):
            continue
        f = spec.results[one.output]
        made = field(f) if one.output in spec.outputs else field(f) | {"name": ""}
        layer = {"file": one.file, "layer": str(one.options.get("layer", ""))}
        stem = one.options.get("layer") or one.file.partition(".")[0]
        label = made["label"] if made["name"] else language.text(in_words(str(stem)))
        kept = {key: made[key] for key in ("name", "type", *LOOKS) if key in made}
        found.setdefault(one.output, kept | layer | {"label": label})
    return list(found.values())


# Help --------------------------------------------------------------------------------------------


def help_page(spec: Spec) -> str:
    """The help of a tool in the simple HTML that QGIS shows beside the dialog."""
    first, _, more = (spec.text or f"{spec.title}.").partition("\n\n")
    more = in_dialog(language.paragraphs(more), spec)
    lines = [_html(f"{language.text(first.removesuffix('.'))}."), _html(more)]
    for head, fields in (
        (language.text("Input parameters"), _inputs(spec)),
        (language.text("Outputs"), [*_results(spec), *_set(spec), *_shown()]),
    ):
        lines += [f"<h3>{head}</h3>", *(_entry(one, spec) for one in fields)]
    told = language.text("On the command line:")
    return "\n".join([*filter(None, lines), f"<p>{told} <code>{spec.id}</code></p>"])


def in_dialog(text: str, spec: Spec) -> str:
    """A text in which names of inputs, outputs, options and tools in backquotes are titles.

    >>> spec = catalog.load("classify.buildings")
    >>> in_dialog("at least `min_height` above it; see `points.denoise` and `planes`", spec)
    'at least *Lowest roof* above it; see *Remove noise* and `planes`'
    """
    titles = {name: language.text(f.title) for name, f in _fields(spec).items()}
    titles |= {
        f"--{f['name'].replace('_', '-')}": f["label"]
        for f in [*general(spec), *_head(spec), *_shown(), *_set(spec)]
    }

    def title(found: re.Match[str]) -> str:
        name = found[1]
        if name in titles:
            return f"*{titles[name]}*"
        return f"*{language.text(catalog.load(name).title)}*" if name in tools else found[0]

    tools = set(catalog.ids())
    return re.sub(r"`+([a-z_.-]+)`+", title, text)


def _entry(made: dict[str, Any], spec: Spec) -> str:
    """The help of one box or result of the dialog, with what it may be."""
    several = made["many"] and made["type"] == "text" and "required" in made
    says = [language.text("several with ; between")] if several else []
    says += [made["rule"]] if made.get("rule") else []
    rule = f" ({'; '.join(says)})" if says else ""
    return f"<p><b>{made['label']}</b>: {_inline(in_dialog(made['help'], spec) + rule)}.</p>"


def _html(text: str) -> str:
    """Convert the paragraphs, lists and `names` of a help text to HTML."""
    made = []
    for block in re.split(r"\n\s*\n", text.strip()):
        items = re.split(r"(?m)^- ", block)
        made += [f"<p>{_inline(items[0])}</p>"] * bool(items[0].strip())
        if items[1:]:
            made.append("<ul>" + "".join(f"<li>{_inline(i)}</li>" for i in items[1:]) + "</ul>")
    return "\n".join(made)


def _inline(text: str) -> str:
    plain = html.escape(" ".join(text.split()), quote=False)
    plain = re.sub(r"`+([^`]+)`+", r"<code>\1</code>", plain)
    return re.sub(r"\*([^*]+)\*", r"<i>\1</i>", plain)
