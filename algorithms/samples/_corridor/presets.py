"""The presets of corridors: power lines as varied as the world has them, and what is no line.

An entry says what is special about it; everything else is as in the defaults of `Preset`. Where two
values are given, the seed chooses between them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

from algorithms.samples._corridor import no_lines
from algorithms.samples._corridor.flights import Flight
from algorithms.samples._corridor.heads import (
    ABOVE_EACH_OTHER,
    BARE_FLAT,
    BARREL,
    BIG_BARREL,
    DANUBE,
    DAVIT,
    DELTA,
    DOUBLE_DAVIT,
    EIGHT_CIRCUITS,
    FLAT_ARM,
    FOUR_CIRCUITS,
    H_FLAT,
    HALF_LEAVES,
    LATTICE_TRIANGLE,
    ONE_LEVEL,
    ONE_WIRE,
    POLE_TRIANGLE,
    POST_DELTA,
    SINGLE,
    TWO_ON_AN_ARM,
    WIDE_FLAT,
    pair,
    phases,
    square,
    triangle,
    upright,
)
from algorithms.samples._corridor.land import Land, Plants, Street
from algorithms.samples._corridor.lines import Line
from algorithms.samples._corridor.no_lines import Structure
from algorithms.samples._corridor.routes import Range


@dataclass(frozen=True)
class Preset:
    """A kind of corridor.

    Attributes
    ----------
    lines : the first is the main one, by whose supports others cross or leave
    length : of the route, metres
    legs, bends : straight pieces of the route, and the angles between them, degrees
    others : what stands and hangs there and is no power line
    """

    lines: tuple[Line, ...] = ()
    length: float = 700.0
    legs: int = 1
    bends: Range = (3.0, 15.0)
    land: Land = field(default_factory=Land)
    plants: Plants = field(default_factory=Plants)
    street: Street | None = None
    others: tuple[Structure, ...] = ()
    flight: Flight = field(default_factory=Flight)


WOOD = Line("pole", POLE_TRIANGLE, (9.5, 12.5), (60, 110), (350, 700), string=-0.25)
WOOD_FLAT = Line("pole", FLAT_ARM, (9.5, 12.0), (50, 90), (300, 600), string=-0.25)
STREET_ARM = replace(WOOD_FLAT, span=(35, 50))
LOW_VOLTAGE = Line("pole", ABOVE_EACH_OTHER, (8.0, 9.0), (30, 42), (90, 200), string=0.0, clear=5.0)
SLIM = Line("slim_lattice", POLE_TRIANGLE, (12, 15), (90, 140), (500, 900), string=0.4)
H_FRAME = Line("h_frame", H_FLAT, (17, 22), (180, 280), (900, 1500))
TWO_CIRCUITS = Line("lattice", BARREL, (30, 38), (220, 320), (900, 1500), jumpers=True)
HIGH = Line(
    "lattice",
    DANUBE,
    (44, 54),
    (300, 400),
    (1200, 2000),
    string=4.0,
    bundle=pair(0.4),
    jumpers=True,
)
TUBES = Line("tube", DOUBLE_DAVIT, (24, 32), (140, 220), (800, 1400))

WOODS = Plants(trees=350, tall=(8, 24))
BARE = Plants(trees=5, shrubs=5)
HILLY = Land(hills=25, wave=500)
STEEP = Land(hills=9, wave=260, across=0.42)

Name = Literal[
    "wood_poles",
    "wood_poles_sparse",
    "wires_barely_seen",
    "wood_poles_steep",
    "one_wire",
    "two_wires",
    "slim_masts",
    "a_poles_bends",
    "street_flat_arms",
    "street_low_voltage",
    "street_both",
    "service_drops",
    "h_frames",
    "h_frames_hills",
    "portal_frames",
    "lattice_triangle",
    "cat_heads",
    "one_level",
    "barrel_bundles",
    "danube",
    "square_bundles",
    "upright_bundles",
    "four_circuits",
    "eight_circuits",
    "tubes",
    "tubes_one_sided",
    "compact_tubes",
    "guyed_v_masts",
    "guyed_masts",
    "valley_span",
    "mountain",
    "mountain_across",
    "sharp_bends",
    "crossing_over_poles",
    "crossing_lattice",
    "branch_poles",
    "branch_lattice",
    "circuit_leaves",
    "dead_end",
    "parallel_lines",
    "shifted_strips",
    "wind",
    "woods_through_wires",
    "hidden_pieces",
    "old_survey",
    "dense_survey",
    "noisy_hills",
    "wandering_flight",
    "line_and_railway",
    "line_and_chairlift",
    "line_and_cranes",
    "no_line_railway",
    "no_line_chairlift",
    "no_line_gondola",
    "no_line_cranes",
    "no_line_fences",
    "no_line_viaduct",
    "no_line_street",
    "no_line_radio_masts",
    "no_line_hop_garden",
    "no_line_suspension_bridge",
]

PRESETS: dict[Name, Preset] = {
    # distribution lines in the open
    "wood_poles": Preset((WOOD,), legs=3),
    "wood_poles_sparse": Preset(
        (WOOD,), length=900, legs=2, flight=Flight(density=2, on_wire=8, noise=0.08, half=40)
    ),
    "wires_barely_seen": Preset(
        (WOOD_FLAT, replace(H_FRAME, offset=-24.0)),
        length=900,
        flight=Flight(density=8, on_wire=3, half=40),
    ),
    "wood_poles_steep": Preset(
        (replace(WOOD_FLAT, span=(70, 150), c=(500, 1100)),),
        legs=2,
        land=STEEP,
        plants=WOODS,
        flight=Flight(density=8, on_wire=20, noise=0.06),
    ),
    "one_wire": Preset(
        (Line("pole", ONE_WIRE, (11, 14), (180, 300), (700, 1100), string=-0.2),),
        length=1200,
        legs=2,
        land=HILLY,
        flight=Flight(density=6, on_wire=15, half=25),
    ),
    "two_wires": Preset(
        (Line("pole", TWO_ON_AN_ARM, (10, 13), (100, 160), (450, 800), string=-0.2),),
        length=900,
        legs=3,
        flight=Flight(density=8, on_wire=25, noise=0.05, half=30),
    ),
    "slim_masts": Preset((SLIM,), length=900, legs=2, flight=Flight(density=10, on_wire=30)),
    "a_poles_bends": Preset(
        (replace(WOOD_FLAT, dead_end="a_pole", every=4),), legs=4, bends=(15, 40)
    ),
    # distribution lines among houses
    "street_flat_arms": Preset(
        (replace(STREET_ARM, offset=5.0),),
        length=400,
        legs=2,
        street=Street(),
        plants=Plants(trees=25, tall=(4, 10), belt=3.0),
        flight=Flight(density=16, on_wire=40),
    ),
    "street_low_voltage": Preset(
        (replace(LOW_VOLTAGE, offset=-4.5),),
        length=400,
        legs=2,
        street=Street(storeys=(1, 2)),
        plants=Plants(trees=25, tall=(4, 10), belt=2.0),
        flight=Flight(density=20, on_wire=40),
    ),
    "street_both": Preset(
        (replace(STREET_ARM, offset=5.0), replace(LOW_VOLTAGE, offset=-5.0)),
        length=400,
        street=Street(storeys=(2, 3)),
        others=(partial(no_lines.lamps, offset=-6.0),),
        plants=Plants(trees=30, tall=(4, 12), belt=2.0),
        flight=Flight(density=12, on_wire=25),
    ),
    "service_drops": Preset(
        (replace(LOW_VOLTAGE, offset=4.5),),
        length=350,
        street=Street(storeys=(1, 2), drops=0.8),
        plants=Plants(trees=20, tall=(4, 9), belt=2.0),
        flight=Flight(density=25, on_wire=45),
    ),
    # transmission lines, one circuit
    "h_frames": Preset((H_FRAME,), length=1000, legs=2),
    "h_frames_hills": Preset(
        (
            Line(
                "h_frame",
                WIDE_FLAT,
                (24, 30),
                (380, 560),
                (1300, 2000),
                string=3.0,
                bundle=pair(0.45),
            ),
        ),
        length=1500,
        legs=2,
        land=Land(hills=45, wave=900),
        plants=WOODS,
        flight=Flight(density=6, on_wire=25, noise=0.18, wander=0.03),
    ),
    "portal_frames": Preset(
        (Line("portal", BARE_FLAT, (12, 16), (40, 70), (250, 500), string=1.5, every=1),),
        length=300,
        plants=BARE,
        flight=Flight(density=20, on_wire=50),
    ),
    "lattice_triangle": Preset(
        (Line("lattice", LATTICE_TRIANGLE, (22, 28), (180, 260), (800, 1300), jumpers=True),),
        length=900,
        legs=2,
        land=HILLY,
    ),
    "cat_heads": Preset(
        (
            Line(
                "cat_head", DELTA, (26, 34), (260, 380), (1100, 1800), string=2.5, bundle=pair(0.4)
            ),
        ),
        length=1100,
        land=HILLY,
        plants=WOODS,
    ),
    # transmission lines, several circuits
    "one_level": Preset(
        (Line("lattice", ONE_LEVEL, (26, 32), (280, 380), (1100, 1800), string=2.0, jumpers=True),),
        length=1000,
        legs=2,
    ),
    "barrel_bundles": Preset(
        (
            Line(
                "lattice",
                BIG_BARREL,
                (52, 62),
                (320, 420),
                (1300, 2000),
                string=4.0,
                bundle=triangle(0.4),
                every=3,
            ),
        ),
        length=1100,
        legs=2,
        flight=Flight(density=15, on_wire=45, half=40),
    ),
    "danube": Preset((HIGH,), length=1100, legs=2, flight=Flight(density=10, on_wire=35, half=40)),
    "square_bundles": Preset(
        (
            Line(
                "lattice",
                BIG_BARREL,
                (58, 66),
                (350, 450),
                (1500, 2200),
                string=4.5,
                bundle=square(0.45),
                jumpers=True,
            ),
        ),
        length=1100,
        legs=2,
        flight=Flight(density=14, on_wire=40, noise=0.05, half=40),
    ),
    "upright_bundles": Preset(
        (
            Line(
                "lattice",
                ONE_LEVEL,
                (28, 34),
                (250, 340),
                (1000, 1600),
                string=2.5,
                bundle=upright(0.4),
            ),
        ),
        length=900,
        flight=Flight(density=12, on_wire=30, noise=0.05),
    ),
    "four_circuits": Preset(
        (
            Line(
                "lattice",
                FOUR_CIRCUITS,
                (52, 60),
                (280, 380),
                (1200, 1900),
                string=3.0,
                bundle=pair(0.4),
                jumpers=True,
            ),
        ),
        length=900,
        legs=2,
        flight=Flight(density=14, on_wire=40, half=40),
    ),
    "eight_circuits": Preset(
        (
            Line(
                "lattice",
                EIGHT_CIRCUITS,
                (70, 80),
                (300, 380),
                (1300, 2000),
                string=2.5,
                bundle=pair(0.4),
            ),
        ),
        length=800,
        flight=Flight(density=14, on_wire=35, half=45),
    ),
    "tubes": Preset((TUBES,), length=800, legs=3, plants=BARE),
    "tubes_one_sided": Preset(
        (Line("tube", DAVIT, (22, 28), (120, 190), (700, 1200)),),
        length=700,
        legs=2,
        bends=(10, 30),
    ),
    "compact_tubes": Preset(
        (Line("tube", POST_DELTA, (18, 24), (100, 160), (700, 1200), string=0.0),),
        length=600,
        street=Street(set_back=(16, 24)),
        flight=Flight(density=15, on_wire=35),
    ),
    "guyed_v_masts": Preset(
        (
            Line(
                "guyed_v",
                WIDE_FLAT,
                (28, 36),
                (320, 450),
                (1300, 2000),
                string=3.0,
                bundle=pair(0.45),
            ),
        ),
        length=1200,
        plants=WOODS,
        flight=Flight(density=10, on_wire=35, half=40),
    ),
    "guyed_masts": Preset(
        (
            Line("guyed_mast", LATTICE_TRIANGLE, (22, 28), (160, 240), (800, 1300)),
            Line(
                "stayed_pole",
                WOOD.head,
                (10, 12),
                (70, 100),
                (400, 700),
                string=-0.25,
                offset=-22.0,
            ),
        ),
        length=700,
    ),
    # relief
    "valley_span": Preset(
        (
            Line(
                "lattice",
                BARREL,
                (34, 44),
                (300, 400),
                (1500, 2200),
                string=2.0,
                posts=(-0.06, 0.08, 0.92, 1.05),
                jumpers=True,
            ),
        ),
        length=1350,
        land=Land(hills=10, valley=(180, 360)),
        plants=WOODS,
        flight=Flight(density=5, on_wire=20, noise=0.08),
    ),
    "mountain": Preset(
        (Line("lattice", LATTICE_TRIANGLE, (24, 34), (280, 620), (1200, 2000), jumpers=True),),
        length=1600,
        legs=3,
        land=Land(hills=70, wave=900, along=0.15),
        plants=WOODS,
        flight=Flight(density=6, on_wire=20, noise=0.08),
    ),
    "mountain_across": Preset(
        (Line("lattice", BARREL, (28, 34), (200, 380), (1000, 1600)),),
        length=1000,
        legs=3,
        bends=(10, 35),
        land=Land(hills=25, wave=350, across=0.38),
        plants=WOODS,
        flight=Flight(density=8, on_wire=25, noise=0.06),
    ),
    # bends, crossings, branches, ends
    "sharp_bends": Preset(
        (Line("lattice", BARREL, (28, 34), (150, 240), (800, 1300), jumpers=True),),
        length=1000,
        legs=4,
        bends=(30, 60),
        flight=Flight(half=30),
    ),
    "crossing_over_poles": Preset(
        (HIGH, replace(WOOD_FLAT, way="across", reach=300)), length=700, plants=BARE
    ),
    "crossing_lattice": Preset(
        (
            Line("lattice", BARREL, (28, 34), (220, 260), (900, 1200)),
            Line(
                "lattice",
                ONE_LEVEL,
                (40, 44),
                (220, 260),
                (1300, 1700),
                string=2.0,
                way="across",
                reach=450,
                angle=(35, 80),
            ),
        ),
        length=700,
    ),
    "branch_poles": Preset(
        (
            WOOD_FLAT,
            Line(
                "pole",
                phases((-1.1, 1.3), (0.35, 1.3), (1.1, 1.3)),
                (9.5, 12.0),
                (50, 90),
                (300, 600),
                string=-0.25,
                way="aside",
                reach=280,
            ),
        ),
        length=500,
        legs=2,
    ),
    "branch_lattice": Preset(
        (
            TWO_CIRCUITS,
            Line(
                "lattice",
                LATTICE_TRIANGLE,
                (26, 32),
                (180, 240),
                (800, 1200),
                way="aside",
                reach=450,
                at=0.4,
            ),
        ),
        length=800,
    ),
    "circuit_leaves": Preset(
        (Line("lattice", HALF_LEAVES, (30, 36), (200, 280), (900, 1400), every=1),), length=1000
    ),
    "dead_end": Preset(
        (
            Line(
                "lattice", ONE_LEVEL, (28, 34), (180, 260), (900, 1300), dead_end="portal", ends=0.6
            ),
            Line(
                "pole",
                FLAT_ARM,
                (9.5, 11.5),
                (50, 80),
                (300, 600),
                string=-0.25,
                offset=-22.0,
                begins=0.3,
            ),
        ),
        length=800,
    ),
    "parallel_lines": Preset(
        (
            HIGH,
            Line("lattice", BARREL, (28, 34), (220, 320), (900, 1500), offset=32.0),
            Line("h_frame", H_FLAT, (16, 20), (150, 220), (900, 1300), offset=-28.0),
        ),
        length=700,
        flight=Flight(density=10, half=60),
    ),
    # the survey
    "shifted_strips": Preset(
        (TWO_CIRCUITS, replace(WOOD, offset=-26.0)),
        length=600,
        legs=2,
        flight=Flight(density=20, strips=4, on_wire=60, shift=(0.05, 0.20), noise=0.04, half=40),
    ),
    "wind": Preset(
        (TWO_CIRCUITS, replace(WOOD_FLAT, offset=-26.0)),
        length=700,
        flight=Flight(density=12, strips=2, wind=(5, 25), half=40),
    ),
    "woods_through_wires": Preset(
        (replace(WOOD, offset=9.0), replace(H_FRAME, offset=-12.0)),
        length=600,
        plants=Plants(trees=500, tall=(8, 24), belt=4.0, below=3.0, reach=(0.75, 1.25)),
        flight=Flight(density=16, on_wire=30),
    ),
    "hidden_pieces": Preset(
        (TWO_CIRCUITS, replace(WOOD, offset=-26.0)),
        length=700,
        plants=Plants(trees=200, below=1.0, reach=(0.8, 1.05)),
        flight=Flight(hidden=0.25, on_wire=20, half=40),
    ),
    "old_survey": Preset(
        (replace(HIGH, bundle=SINGLE),),
        length=2000,
        legs=2,
        flight=Flight(density=1, strips=1, on_wire=10, noise=0.20, wander=0.05, half=50),
    ),
    "dense_survey": Preset(
        (replace(TUBES, bundle=pair(0.3)), replace(WOOD, offset=-20.0)),
        length=350,
        flight=Flight(density=60, strips=3, on_wire=60, shift=(0.02, 0.05), half=30),
    ),
    "noisy_hills": Preset(
        (
            Line(
                "guyed_v",
                WIDE_FLAT,
                (28, 34),
                (380, 520),
                (1300, 1800),
                string=3.0,
                bundle=pair(0.5),
            ),
            Line("h_frame", H_FLAT, (18, 22), (200, 280), (900, 1400), offset=-38.0),
        ),
        length=1300,
        land=Land(hills=22, wave=700),
        plants=WOODS,
        flight=Flight(density=8, on_wire=30, noise=0.25, wander=0.04, half=60),
    ),
    "wandering_flight": Preset(
        (SLIM, replace(WOOD_FLAT, offset=-24.0)),
        length=800,
        flight=Flight(density=12, strips=3, wander=0.05, shift=(0.05, 0.10), half=40),
    ),
    # lines beside what is none
    "line_and_railway": Preset(
        (replace(WOOD, offset=15.0), replace(TUBES, offset=-20.0)),
        length=600,
        others=(no_lines.railway, partial(no_lines.fences, offsets=(-9.0, 9.0))),
        flight=Flight(density=16, half=40),
    ),
    "line_and_chairlift": Preset(
        (WOOD, replace(HIGH, offset=-30.0, clear=22.0)),
        length=700,
        land=Land(hills=10, along=0.3),
        others=(partial(no_lines.cableway, angle=75.0, every=40.0, height=16.0),),
        flight=Flight(half=60),
    ),
    "line_and_cranes": Preset(
        (replace(TUBES, offset=14.0),),
        length=500,
        others=(
            partial(no_lines.cranes, offset=(-30.0, -10.0), height=(38.0, 55.0)),
            no_lines.lamps,
        ),
        plants=BARE,
        flight=Flight(density=16, half=45),
    ),
    # no power line at all
    "no_line_railway": Preset(
        length=500,
        legs=2,
        others=(
            partial(no_lines.railway, tracks=4),
            partial(no_lines.fences, offsets=(-20.0, 20.0)),
        ),
        flight=Flight(density=16),
    ),
    "no_line_chairlift": Preset(
        length=600, land=Land(hills=10, along=0.4), others=(no_lines.cableway,), plants=WOODS
    ),
    "no_line_gondola": Preset(
        length=800,
        land=Land(hills=12, along=0.35),
        others=(partial(no_lines.cableway, every=120.0, height=22.0, hangs=60.0, cabins=True),),
        plants=WOODS,
    ),
    "no_line_cranes": Preset(
        length=350, others=(no_lines.cranes,), plants=BARE, flight=Flight(density=16, half=50)
    ),
    "no_line_fences": Preset(
        length=400,
        land=Land(hills=15, wave=200),
        others=(no_lines.fences, partial(no_lines.tree_rows, offsets=(-25.0, 25.0))),
        flight=Flight(density=25),
    ),
    "no_line_viaduct": Preset(
        length=500, land=Land(hills=6), others=(no_lines.viaduct,), flight=Flight(density=20)
    ),
    "no_line_street": Preset(
        length=350,
        legs=2,
        street=Street(storeys=(1, 4)),
        others=(no_lines.lamps, partial(no_lines.tree_rows, offsets=(-6.0, 6.5), every=14.0)),
        plants=Plants(trees=30, tall=(4, 12)),
        flight=Flight(density=20),
    ),
    "no_line_radio_masts": Preset(
        length=300, others=(no_lines.radio_masts,), flight=Flight(density=16, half=45)
    ),
    "no_line_hop_garden": Preset(
        length=300, others=(no_lines.hop_garden,), plants=BARE, flight=Flight(density=20)
    ),
    "no_line_suspension_bridge": Preset(
        length=300,
        land=Land(hills=1, valley=(12, 60)),
        others=(no_lines.suspension_bridge,),
        flight=Flight(density=20),
    ),
}
