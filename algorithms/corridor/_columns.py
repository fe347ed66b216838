"""Headings and units of the columns of corridors, as reports show them."""

from __future__ import annotations

from toolbox.data.report import Column

LENGTHS = {
    "clearance": Column(
        "Clearance",
        "m",
        2,
        meaning="In the direction of the rule; of a tree that may fall, as it stands",
    ),
    "clearance_low": Column(
        "Clearance, least at other temperatures",
        "m",
        2,
        meaning="Of an object with the rest of its tree or building; too narrow in spans that the "
        "data cut; empty where the clearance is that in another state than the survey",
    ),
    "clearance_high": Column("Clearance, greatest at other temperatures", "m", 2),
    "required": Column("Required", "m", 2),
    "distance": Column("Distance in space", "m", 2),
    "vertical": Column("Below the wire", "m", 2),
    "horizontal": Column("Beside the wire", "m", 2),
    "chainage": Column("Along the span", "m", 1),
}

OBJECTS = {
    **LENGTHS,
    "object_id": Column("Object"),
    "clump": Column(
        "Clump",
        meaning="Objects with the same number touch, as trees of one group or parts of one tree",
    ),
    "severity": Column("Severity"),
    "kind": Column("Kind"),
    "rule": Column("Rule"),
    "sd": Column("Standard deviation", "m", 2, never_zero=True),
    "probability": Column("Probability that the rule is broken", "%", 0, 100.0),
    "falls": Column("Gap to the wire when it falls (below 0: beyond it)", "m", 1),
    "height": Column(
        "Height above the ground",
        "m",
        1,
        meaning="Of its highest listed point: outside of what is listed a plant may be higher",
    ),
    "state": Column("State of the wires"),
    "as_surveyed": Column(
        "Of this severity also as surveyed",
        meaning="No: less severe, or not listed, unless the wires are hot or in wind",
    ),
    "severity_surveyed": Column(
        "Severity as surveyed", meaning="Empty: listed only with the wires hot or in wind"
    ),
    "clearance_surveyed": Column(
        "Clearance as surveyed", "m", 2, meaning="From the same wire; empty where the rule has none"
    ),
    "may_be_wire": Column("Shape of a wire"),
    "may_touch": Column(
        "May touch the wire",
        meaning="Points on the wire count as of it, so no smaller distance than told can be seen",
    ),
    "points": Column("Points"),
    "elevation": Column("Elevation", "unit", 2),
}

UNSURE = {
    **{name: OBJECTS[name] for name in ("object_id", "vertical", "horizontal", "chainage")},
    **{name: OBJECTS[name] for name in ("height", "state", "points", "may_be_wire", "elevation")},
    "distance": Column("Distance in space", "m", 2),
    "severity": OBJECTS["severity"],
    "source": Column("What to do"),
}

SPANS = {
    **LENGTHS,
    "temperature": Column("Temperature", "°C", 0),
    "wind": Column("Wind", "m/s", 1),
    "state": Column("State of the wires"),
    "from_tower": Column("From tower (0: end of the data)"),
    "to_tower": Column("To tower (0: end of the data)"),
    "conductors": Column(
        "Conductors found", "", 0, meaning="Guard wires count as well, and a bundle as one"
    ),
    "expected": Column("Conductors in neighbouring spans", "", 0),
    "seen_share": Column("Seen of the conductor seen least", "%", 0, 100.0),
    "wire_like": Column("Wire-like points beside it", "m", 0),
    "length": Column("Length", "m", 1),
    "sag": Column("Sag", "m", 2),
    "swing": Column(
        "Swing of the wire that swings most",
        "°",
        1,
        meaning="Empty where the wires sag too little to tell",
    ),
    "swing_sd": Column(
        "Standard deviation of the swing",
        "°",
        1,
        meaning="Of the wires as surveyed: by the scatter of the points, how much was seen, and "
        "how far the wires of the span disagree; empty, as the swing, above 2 degrees",
        never_zero=True,
    ),
    "clearance_sd": Column("Standard deviation of the clearance", "m", 2, never_zero=True),
    **{
        kind: Column(f"To {word}", "m", 2)
        for kind, word in {
            "tree": "trees",
            "building": "buildings",
            "other": "other objects",
            "unclassified": "what has no class",
            "ground": "the ground",
            "water": "water",
            "rail": "rails",
            "road": "roads",
            "line": "another line",
        }.items()
    },
    "ground_at": Column("Nearest ground, along the span", "m", 0),
    "ground_low": Column("To the ground, least at other temperatures", "m", 2),
    "ground_high": Column("To the ground, greatest at other temperatures", "m", 2),
    "points_0_20": Column("Points at 0 to 20 m"),
    "points_20_30": Column("Points at 20 to 30 m"),
    "objects": Column(
        "Objects too close",
        meaning="Each counted in the state of the wires in which it is worst",
    ),
    "watched": Column("Objects to be watched", meaning="Counted likewise"),
    "no_rule": Column("Objects near without a rule", meaning="Counted likewise"),
}

KINDS = {
    "kind": Column("Kind"),
    "nearest": Column("Nearest", "m", 2),
    "too close": Column("Too close"),
    "watched": Column("To be watched"),
    "may fall": Column(
        "May fall on a wire", "", 0, meaning="Empty: not looked at; of trees alone it is"
    ),
    "near, no rule": Column("Near without a rule"),
    "points_0_20": SPANS["points_0_20"],
    "points_20_30": SPANS["points_20_30"],
    "rule": Column("Rules"),
}

RULES = {
    "number": Column("Number"),
    "rule": OBJECTS["rule"],
    "kind": OBJECTS["kind"],
    "direction": Column("Direction"),
    "distance": Column("Distance", "m", 3),
    "within": Column("Within", "m", 3),
    "severity": OBJECTS["severity"],
    "confirmed": Column("Confirmed"),
    "source": Column("Source"),
    "date": Column("Date"),
    "note": Column("Note"),
}

CROSSINGS = {
    **LENGTHS,
    "crossing_id": Column("Crossing"),
    "other_span": Column("Other span"),
    "other_wire": Column("Other wire"),
    "other_state": Column("State of the other wire"),
    "other_chainage": Column("Along the other span", "m", 1),
}

_OF_CURVES = {  # in files only; u runs along the axis, v to its left
    "bundle_id": Column("", meaning="Number of the bundle in the span"),
    "x0": Column("", "unit", meaning="Easting of the start of the axis of the wire, u = 0"),
    "y0": Column("", "unit", meaning="Northing of the start of the axis of the wire"),
    "u0": Column("", "m", meaning="Lowest point of the catenary, along the axis"),
    "z0": Column("", "unit", meaning="Lowest point of the catenary, elevation"),
    "v0": Column("", "m", meaning="Offset to the left of the axis at its start; see v1 and swing"),
    "v1": Column("", "m/m", meaning="Offset to the left of the axis for each metre along it"),
    "curvature": Column("", "1/m", meaning="1 / c"),
    "var_start": Column("", "m²", meaning="Variance of the elevation at the start"),
    "var_end": Column("", "m²", meaning="Variance of the elevation at the end"),
    "var_curv": Column("", "1/m²", meaning="Variance of the curvature"),
    "cov_start_end": Column("", "m²", meaning="Covariance of both elevations"),
    "cov_start_curv": Column("", meaning="Covariance of elevation at the start and curvature"),
    "cov_end_curv": Column("", meaning="Covariance of elevation at the end and curvature"),
    "sd_c": Column("", "m", meaning="Standard deviation of c"),
    "sd_u0": Column("", "m", meaning="Standard deviation of u0"),
    "sd_z0": Column("", "m", meaning="Standard deviation of z0"),
}

WIRES = {
    **_OF_CURVES,
    "from_tower": SPANS["from_tower"],
    "to_tower": SPANS["to_tower"],
    "azimuth": Column(
        "Azimuth", "°", 1, meaning="Direction of the axis, clockwise from grid north"
    ),
    "span": Column("Span length", "m", 1, meaning="Length of the axis, in plan"),
    "c": Column("Catenary constant", "m", 0, meaning="Horizontal tension over weight"),
    "swing": Column(
        "Swing (unsure where its standard deviation is above 2°)",
        "°",
        1,
        meaning="Angle by which it hangs beside the vertical, above 0 to the left of the axis; "
        "empty where it sags too little to tell, unsure where sd_swing is above 2 degrees",
    ),
    "sd_swing": Column(
        "Standard deviation of the swing",
        "°",
        1,
        meaning="By the scatter of the points, how much was seen, and how far the wires of the "
        "span disagree",
        never_zero=True,
    ),
    "sag": Column("Sag", "m", 2, meaning="Greatest vertical distance below its chord"),
    "length": Column("Length of the wire", "m", 1),
    "rms": Column(
        "Root mean square error",
        "m",
        3,
        meaning="Root mean square of the distances of its points from it, square to the axis",
    ),
    "points": Column("Points", meaning="Points to which it was fitted"),
    "seen_from": Column("Seen from", "m", 0, meaning="First of its points, along the axis"),
    "seen_to": Column("Seen to", "m", 0, meaning="Last of its points, along the axis"),
    "seen_share": Column(
        "Seen",
        "%",
        0,
        100.0,
        meaning="Share of its length without gaps longer than the spacing of its points explains",
    ),
    "longest_gap": Column("Longest gap", "m", 1),
    "conductors": SPANS["conductors"],
    "expected": SPANS["expected"],
    "z_start": Column("Elevation at the start", "m", 2),
    "z_end": Column("Elevation at the end", "m", 2),
    "sd_sag": Column("Standard deviation of the sag", "m", 3, never_zero=True),
    "drop": Column("Service drop", meaning="1 if it leads from a pole to a house, else 0"),
}

TOWERS = {
    "tower_id": Column("Tower"),
    "kind": Column("Kind"),
    "height": Column("Height", "m", 1),
    "top": Column(
        "Elevation of the top",
        "m",
        2,
        meaning="Of its highest point, but for one or two a metre or more above all others: birds",
    ),
    "elevation": Column("Elevation", "unit", 2),
    "low_wire": Column("Lowest wire", "m", 2, meaning="Elevation of the lowest end of a wire"),
    "high_wire": Column("Highest wire", "m", 2, meaning="Elevation of the highest end of a wire"),
    "azimuth": Column("Azimuth", "°", 0, meaning="Of the arms, clockwise from grid north"),
    "width": Column("Width", "m", 1, meaning="Of the body just below the arms"),
    "arms": Column("Between the outermost wires", "m", 1),
    "string": Column(
        "Length of strings",
        "m",
        1,
        meaning="Of those by which wires pull; empty where they hang, of which it is not known",
    ),
    "body": Column("Seen of its height", "%", 0, 100.0),
    "sd_along": Column("Standard deviation of its place along the line", "m", 1),
    "certain": Column(
        "Certain (1), or told by wires alone, in an unsure place or by no body of its own (0)"
    ),
}
