"""The verb ``model``: checks, shows or begins a model, or exchanges it with QGIS."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox import catalog, files
from toolbox.counting import agree
from toolbox.errors import DataError, ParameterError
from toolbox.models import documents

if TYPE_CHECKING:
    from toolbox.models.model import Model

STARTER = Path(__file__).with_name("starter.yaml")
STARTER_ID = "my.model"
DIAGRAMS = (".mmd", ".md")  # a Mermaid file, or a block of a Markdown file


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.set_defaults(json=False)
    verbs = parser.add_subparsers(dest="what", required=True)
    helps = {
        "check": "say all that is wrong with a model file",
        "show": "print the steps of a model as a Mermaid diagram, or write it",
        "new": "print a model to begin with, or write it into a file",
        "to-qgis": "write a model as a .model3 file of QGIS",
        "from-qgis": "write a .model3 file of QGIS as a model, or say what cannot be converted",
    }
    made = {
        verb: verbs.add_parser(verb, help=text, description=text, allow_abbrev=False)
        for verb, text in helps.items()
    }
    made["check"].add_argument("file")
    made["show"].add_argument("model", help="a model file, or the id of a model")
    made["show"].add_argument(
        "--picture", metavar="FILE", help=f"write it: {' or '.join(DIAGRAMS)}"
    )
    made["show"].add_argument("--overwrite", action="store_true", help="let it replace a file")
    made["new"].add_argument("file", nargs="?")
    made["to-qgis"].add_argument("model", help="a model file, or the id of a model")
    made["from-qgis"].add_argument("model", help="a .model3 file")
    for verb in ("to-qgis", "from-qgis"):
        made[verb].add_argument("file", nargs="?", help="to write; beside the model")
        made[verb].add_argument("--overwrite", action="store_true", help="let it replace a file")
    sets: dict[str, Any] = {"action": "append", "default": [], "metavar": "NAME=VALUE"}
    made["to-qgis"].add_argument("--set", **sets, help="value of an input; switches are fixed")
    says = "optional layer that the model of QGIS asks for"
    made["to-qgis"].add_argument("--with", action="append", default=[], metavar="NAME", help=says)
    says = "take points as layers, for which QGIS must have PDAL"
    made["to-qgis"].add_argument("--point-layers", action="store_true", help=says)


def run(args: argparse.Namespace, _: object) -> None:
    """Run the verb."""
    verbs = {"check": _check, "show": _show, "new": _new}
    verbs |= {"to-qgis": _to_qgis, "from-qgis": _from_qgis}
    print(verbs[args.what](args), end="")


def _check(args: argparse.Namespace) -> str:
    if not args.file.endswith(catalog.MODEL):
        raise ParameterError(f"{args.file} is no model file; those end in {catalog.MODEL[0]}")
    model = _model(args.file)
    width = max(map(len, model.steps))
    reach = model.reach({})
    lines = [agree(f"{args.file}: {model.id} is fine, {len(model.steps)} steps")]
    for name, step in model.steps.items():
        far = reach.get(name, 0.0)
        needs = "needs the whole survey" if math.isinf(far) else f"looks {far:.4g} m around"
        lines.append(f"  {name:{width}}  {step.spec.id}, {needs if name in reach else 'optional'}")
    return "\n".join(lines) + "\n"


def _show(args: argparse.Namespace) -> str:
    from toolbox.models import diagram

    model = _model(args.model)
    if not args.picture:
        return diagram.mermaid(model)
    path = Path(args.picture)
    markdown = path.suffix.lower() == ".md"
    text = diagram.markdown(model) if markdown else diagram.mermaid(model)
    _write(args, "picture", path, DIAGRAMS, text)
    return f"{path}: the steps of {model.id}\n"


def _new(args: argparse.Namespace) -> str:
    text = STARTER.read_text(encoding="utf-8")
    if args.file is None:
        return text
    from toolbox.declare.spec import NAME

    path = Path(args.file)
    if NAME.fullmatch(path.stem):
        text = text.replace(STARTER_ID, f"my.{path.stem}", 1)
    _write(args, "file", path, catalog.MODEL, text)
    return f"{path}: change it, then: model check {path}\n"


def _to_qgis(args: argparse.Namespace) -> str:
    from toolbox.qgis import model as qgis_model

    model = _model(args.model)
    values = {}
    for text in args.set:
        name, sign, value = text.partition("=")
        if not sign:
            raise ParameterError("model to-qgis", {"set": f"must be NAME=VALUE, got {text!r}"})
        values[name] = value
    given = tuple(vars(args)["with"])
    text, notes = qgis_model.to_qgis(model, values, given=given, point_layers=args.point_layers)
    path = _exchanged(args, (qgis_model.SUFFIX,), text)
    return _told(path, notes, f"run it with: qgis_process run {path}")


def _from_qgis(args: argparse.Namespace) -> str:
    from toolbox.qgis import model as qgis_model

    try:
        text = Path(args.model).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as err:
        raise ParameterError(f"{args.model} cannot be read: {err}") from None
    made, notes = qgis_model.from_qgis(text, args.model)
    text = documents.text(made)
    path = _exchanged(args, catalog.MODEL, text)
    return _told(path, notes, f"look at it with: model check {path}")


def _exchanged(args: argparse.Namespace, suffixes: tuple[str, ...], text: str) -> Path:
    """Write the other form of a model: into its file, beside the model, or here for our own."""
    if args.file:
        path = Path(args.file)
    elif args.model in catalog.ids():
        path = Path(args.model.rpartition(".")[2] + suffixes[0])
    else:
        path = Path(args.model).with_suffix(suffixes[0])
    _write(args, "file", path, suffixes, text)
    return path


def _write(
    args: argparse.Namespace, option: str, path: Path, suffixes: tuple[str, ...], text: str
) -> None:
    """Write a text into the file that an option names, or raise what is wrong with its path."""
    overwrite = getattr(args, "overwrite", None)  # `model new` has no such option
    found = files.problems(
        {option: path}, {option: suffixes}, {option: files.itself}, [], overwrite=bool(overwrite)
    )
    if overwrite is None:
        found = {
            n: says.removesuffix("; allow it with overwrite=True") for n, says in found.items()
        }
    if found:
        raise ParameterError(f"model {args.what}", found)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as err:
        raise DataError(f"{path} cannot be written: {err.strerror}") from err


def _told(path: Path, notes: list[str], then: str) -> str:
    return "".join(f"{line}\n" for line in [f"{path}: {then}", *(f"  {n}" for n in notes)])


def _model(name: str) -> Model:
    from toolbox.models.model import Model

    found = catalog.load(name)
    if not isinstance(found, Model):
        raise ParameterError(f"{name} is a tool, no model")
    return found
