"""What each muscle group does to the face: Gaussian pulls and folds in the front view, written for
the left side.

How far the skin goes at full strength follows what was measured in ICT-FaceKit's scanned
expressions (Li et al. 2020, "Learning Formation of Physically-Based Face Attributes"; MIT), at
places counted from the tip of the nose.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Muscle:
    """Displacement `move` (outward, up, forward; mm) times a Gaussian about `center` (x, y; mm) of
    `radii` (mm).

    lip: "" moves all skin there, "upper" or "lower" only that side of the mouth line, "both" both
    lips.
    """

    center: tuple[float, float]
    radii: tuple[float, float]
    move: tuple[float, float, float]
    lip: str = ""


@dataclass(frozen=True)
class Fold:
    """A step in the skin along a line from `line[0]` on (x, y; mm): up by `height` (mm) on the side
    away from the midline, down on the other, most at `width` (mm) from it, fading to its two ends.
    """

    height: float
    width: float = 6.0
    line: tuple[tuple[float, float], ...] = ((18, -43), (24, -51), (30, -60), (34, -71), (36, -85))


M = Muscle
F = Fold
_CORNER = (25.0, -73.0)

# One-sided shapes: made twice, for the left and for the right.
ONE_SIDED: dict[str, tuple[Muscle | Fold, ...]] = {
    "browDown": (
        M((30, 20), (30, 12), (-2.0, -2.7, 0.8)),
        M((45, 22), (30, 14), (-2.5, -1.4, 2.2)),
    ),
    "browOuterUp": (
        M((36, 20), (30, 11), (1.3, 5.2, 0.3)),
        M((50, 26), (25, 19), (0.9, 4.1, -2.5)),
    ),
    "cheekSquint": (
        M((48, -42), (15, 30), (-0.9, 2.9, 2.6)),
        M((37, -18), (18, 16), (-1.1, 2.7, 1.0)),
        M((42, -60), (22, 30), (1.6, 2.7, -0.3)),
    ),
    "eyeBlink": (),
    "eyeLookDown": (),
    "eyeLookIn": (),
    "eyeLookOut": (),
    "eyeLookUp": (),
    "eyeSquint": (M((33, -13), (15, 7), (0, 1.6, 0.5)),),
    "eyeWide": (M((32, 14), (15, 8), (0, 1.2, 0)),),
    "mouthDimple": (
        M((23, -79), (12, 18), (2.1, 1.8, -6.0)),
        M((27, -91), (17, 17), (0.1, 4.3, 2.2)),
        M((44, -50), (22, 19), (1.9, 0.8, 4.3)),
    ),
    "mouthFrown": (
        M((30, -71), (16, 26), (1.1, -4.5, -2.0)),
        M((26, -93), (27, 20), (0.1, 0.6, 2.3)),
    ),
    "mouthLowerDown": (
        M((2, -88), (29, 30), (0.4, -4.3, -1.1), "lower"),
        M((18, -97), (28, 19), (1.2, -0.5, -1.3)),
    ),
    "mouthPress": (
        M((18, -70), (30, 8), (-0.2, -0.8, -0.8), "upper"),
        M((6, -92), (30, 30), (-0.1, 3.2, 1.3), "lower"),
        M((32, -84), (19, 30), (0.1, 1.7, 1.7)),
    ),
    "mouthSmile": (
        M((29, -80), (25, 26), (2.1, 8.3, -1.7)),
        M((0, -71), (30, 15), (1.7, -0.1, -4.1), "both"),
        M((39, -57), (25, 25), (4.8, 2.6, -1.6)),
        M((46, -28), (20, 24), (1.1, 2.7, 2.9)),
        F(1.4),
    ),
    "mouthStretch": (
        M((25, -73), (13, 16), (3.1, -2.1, -6.1)),
        M((44, -80), (30, 30), (3.6, 1.0, 0.2)),
    ),
    "mouthUpperUp": (
        M((6, -69), (30, 13), (0.5, 5.1, 0.1), "upper"),
        M((0, -57), (30, 10), (0.4, 1.3, -2.6), "upper"),
        M((23, -49), (9, 21), (2.2, 2.9, -1.3)),
        M((34, -49), (24, 30), (0.6, 4.1, 2.3)),
        F(1.4),
    ),
    "noseSneer": (
        M((28, -52), (16, 30), (-0.1, 4.5, -0.7)),
        M((21, -28), (30, 18), (-0.1, 4.2, 1.8)),
        M((7, -66), (25, 17), (1.2, 4.3, -0.8), "upper"),
        M((42, -57), (27, 30), (-2.1, 4.9, 3.4)),
        M((17, 21), (30, 17), (-0.7, -3.1, -0.1)),
        F(1.0),
    ),
    "AU1_inner_brow_raiser": (
        M((13, 22), (9, 12), (0.4, 6.4, -0.4)),
        M((14, 40), (14, 15), (0, 2.4, 0)),
    ),
    "AU4_brow_gatherer": (
        M((14, 19), (10, 8), (-4.2, -1.2, 0.9)),
        M((5, 14), (6, 7), (-0.8, 0, 0.6)),
    ),
    "AU46_wink": (
        M((36, -18), (18, 14), (0.4, 5.2, 2.2)),
        M((26, 20), (16, 9), (-0.8, -2.6, 0.2)),
        M(_CORNER, (13, 12), (2.0, 3.0, -1)),
    ),
    "AU7_lower_lid_raiser": (M((44, 2), (9, 8), (-0.6, 0, 0)),),
    "lower_lid_lower": (M((32, -13), (13, 7), (0, -1.4, 0)),),
    "AU10_upper_lip_raiser": (
        M((16, -60), (10, 11), (0.6, 4.8, 1.2), "upper"),
        M((32, -40), (14, 13), (0, 2.8, 1.6)),
        F(0.9),
    ),
    "AU11_nasolabial_deepener": (M((28, -49), (11, 11), (-0.3, 1.6, 0.4)), F(2.0)),
    "AU13_sharp_lip_puller": (
        M(_CORNER, (9, 9), (2.0, 7.0, -1.4)),
        M((38, -50), (12, 12), (0, 2.2, 2.8)),
    ),
    "AU16_lower_lip_depressor": (M((15, -84), (12, 9), (2.4, -4.4, 1.6), "lower"),),
    "AU31_jaw_clencher": (
        M((55, -64), (12, 17), (4.0, 0, 0.6)),
        M((60, 22), (12, 13), (1.4, 0, 0.3)),
    ),
    "AU33_cheek_blow": (
        M((42, -66), (19, 17), (6.4, 0, 6.4)),
        M((24, -64), (11, 9), (0.6, 0, 1.8), "upper"),
    ),
    "AU35_cheek_suck": (M((42, -66), (16, 16), (-4.8, 0, -5.0)),),
    "AU38_nostril_dilator": (M((15, -48), (6, 7), (2.4, 0.8, 0.4)),),
}

# Shapes of both sides at once.
BOTH: dict[str, tuple[Muscle | Fold, ...]] = {
    "browInnerUp": (M((5, 9), (15, 30), (0, 3.4, 0.2)), M((21, 28), (27, 19), (0.5, 4.4, 0.1))),
    "cheekPuff": (
        M((38, -69), (30, 30), (3.0, 3.6, 11.2)),
        M((12, -73), (30, 16), (-3.8, -1.2, 4.9), "both"),
    ),
    "mouthFunnel": (
        M((24, -74), (30, 20), (-3.9, 2.2, 6.6)),
        M((0, -67), (21, 9), (3.0, 2.9, 4.1), "upper"),
        M((0, -79), (23, 30), (3.1, -8.8, -0.6), "lower"),
    ),
    "mouthPucker": (
        M((34, -77), (23, 30), (-3.7, 3.1, 5.0)),
        M((7, -73), (27, 15), (-0.9, -0.8, 8.2), "both"),
    ),
    "mouthRollLower": (
        M((0, -80), (21, 6.5), (0, 3.2, -5.0), "lower"),
        M((0, -93), (20, 8), (0, 2.0, 0.6), "lower"),
    ),
    "mouthRollUpper": (
        M((0, -68), (21, 5.0), (0, -2.6, -4.6), "upper"),
        M((0, -58), (18, 6), (0, -1.4, 0.5), "upper"),
    ),
    "mouthShrugLower": (
        M((0, -76), (30, 11), (1.5, 3.4, 4.6), "lower"),
        M((0, -99), (30, 21), (-1.3, 10.7, 4.7)),
    ),
    "mouthShrugUpper": (M((0, -68), (19, 14), (0.3, 6.2, 0.8), "upper"),),
    "AU9_nose_wrinkler": (
        M((5, -20), (10, 11), (0, 3.6, 0.6)),
        M((13, 14), (11, 9), (-1.2, -3.2, 0.2)),
        M((16, -47), (9, 8), (0.4, 2.2, 0)),
    ),
    "AU17_chin_raiser": (
        M((0, -101), (17, 11), (0, 5.6, 1.2)),
        M((0, -92), (16, 7), (0, 1.6, 2.0)),
    ),
    "AU22_upper_lip_funnel": (M((0, -66), (16, 7), (0, 3.2, 4.2), "upper"),),
    "AU22_lower_lip_funnel": (M((0, -82), (16, 8), (0, -3.6, 4.4), "lower"),),
    "AU23_lip_tightener": (
        M((0, -67), (20, 5), (0, -2.2, -1.0), "upper"),
        M((0, -80), (20, 6), (0, 2.4, -1.0), "lower"),
        M(_CORNER, (9, 9), (-1.6, 0, -0.6)),
    ),
    "AU25_lips_part": (
        M((0, -69), (19, 8), (0, 1.6, 0), "upper"),
        M((0, -80), (19, 10), (0, -3.4, 0), "lower"),
    ),
    "AU39_nostril_compressor": (
        M((15, -48), (7, 8), (-2.0, 0, 0.4)),
        M((0, -44), (8, 8), (0, -1.2, 0)),
    ),
    "AU21_neck_tightener": (
        M((34, -125), (22, 26), (2.4, -2.6, 3.4)),
        M((30, -92), (17, 14), (1.2, -2.4, 0)),
    ),
    "swallow": (M((0, -150), (12, 15), (0, 8.0, 0.4)), M((0, -126), (20, 11), (0, -2.0, 1.2))),
    "viseme_F": (
        M((0, -79), (18, 7), (0, 3.0, -6.0), "lower"),
        M((0, -67), (18, 6), (0, 1.8, 0.4), "upper"),
    ),
    "viseme_M": (
        M((0, -68), (22, 5), (0, -1.8, -2.6), "upper"),
        M((0, -79), (22, 6), (0, 1.4, -2.8), "lower"),
    ),
}
