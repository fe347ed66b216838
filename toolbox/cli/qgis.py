"""The verb ``qgis``: installs, removes or packs the plugin, or checks its installation."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from toolbox import __version__
from toolbox.errors import DataError, ParameterError


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.set_defaults(json=False)
    verbs = parser.add_subparsers(dest="what", required=True)
    helps = {
        "install": "put the plugin into a QGIS profile and let it use this Python",
        "uninstall": "take the plugin out of a QGIS profile",
        "package": "write the plugin as a zip, as plugins.qgis.org takes it",
        "doctor": "say what is found, what is missing, and how to mend it",
    }
    made = {
        verb: verbs.add_parser(verb, help=text, description=text, allow_abbrev=False)
        for verb, text in helps.items()
    }
    for verb in ("install", "uninstall", "doctor"):
        made[verb].add_argument("--profile", metavar="DIR", help="the profile (that of QGIS)")
    made["package"].add_argument("file", nargs="?", help=f"lidar_toolbox-{__version__}.zip")
    made["package"].add_argument(
        "--wheel", metavar="WHL", help="of the toolbox, from which the plugin makes an environment"
    )
    made["package"].add_argument(
        "--needs", metavar="TXT", help="what the wheel needs, with hashes (requirements of pip)"
    )


def run(args: argparse.Namespace, _: object) -> None:
    """Run the verb."""
    verbs = {"install": _install, "uninstall": _uninstall, "package": _package, "doctor": _doctor}
    print(verbs[args.what](args))


def _install(args: argparse.Namespace) -> str:
    from toolbox.qgis.install import install

    folder = install(_profile(args))
    told = f"{folder}: installed. Start QGIS anew; the tools are in the Processing toolbox."
    if "VIRTUAL_ENV" in os.environ:  # whose Python comes before that of QGIS on the search path
        told += (
            "\nNot from this terminal, where a Python environment is active: QGIS would take it "
            "for its own, and find no plugins. Start it from the menu, or say deactivate first."
        )
    return told


def _uninstall(args: argparse.Namespace) -> str:
    from toolbox.qgis.install import uninstall

    return f"{uninstall(_profile(args))}: removed"


def _package(args: argparse.Namespace) -> str:
    from toolbox.qgis.install import FOLDER, package
    from toolbox.qgis.published import problems

    path = Path(args.file or f"{FOLDER}-{__version__}.zip")
    if args.needs and not args.wheel:
        raise ParameterError("qgis package", {"needs": "is for a wheel; give --wheel too"})
    wheel, needs = (Path(name) if name else None for name in (args.wheel, args.needs))
    told = f"{path}: {package(path, wheel, needs)} files"
    found = problems(path)
    lines = [f"\n  {text}" for text in found]
    heading = "\nplugins.qgis.org would not take it yet:" if found else ""
    return "".join([told, heading, *lines])


def _doctor(args: argparse.Namespace) -> str:
    from toolbox.qgis.install import findings

    found = list(findings(_profile(args)))
    lines = [
        f"mend  {each.what}\n      {each.mend}" if each.mend else f"ok    {each.what}"
        for each in found
    ]
    text = "\n".join(lines)
    if any(each.mend for each in found):
        print(text)
        raise DataError(f"qgis: things to mend: {sum(bool(each.mend) for each in found)}")
    return text


def _profile(args: argparse.Namespace) -> Path:
    from toolbox.qgis.install import default_profile

    return Path(args.profile).absolute() if args.profile else default_profile()
