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
    width: float = 8.0
    line: tuple[tuple[float, float], ...] = ((22, -40), (28, -48), (34, -58), (39, -70), (41, -84))


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
        M((27, -74), (10, 12), (-0.4, 1.5, -6.4)),
        M((31, -89), (13, 18), (-0.9, 3.5, 2.1)),
        M((44, -50), (21, 21), (1.9, 1.1, 4.1)),
        M((20, -88), (19, 20), (3.0, 3.0, -2.8), "lower"),
        M((21, -68), (12, 13), (2.4, -1.4, -0.8), "upper"),
    ),
    "mouthFrown": (
        M((30, -72), (12, 14), (1.4, -2.7, -4.0)),
        M((32, -82), (18, 23), (0.9, -1.7, 2.7)),
        M((30, -57), (30, 23), (-0.2, -1.6, -1.4), "upper"),
    ),
    "mouthLowerDown": (
        M((2, -84), (26, 30), (-0.2, -6.5, -1.3), "lower"),
        M((10, -99), (30, 17), (1.1, -1.2, -2.1)),
        M((24, -88), (17, 15), (1.5, 1.5, 0.7), "lower"),
        M((7, -93), (10, 9), (0.2, 2.2, 0.3), "lower"),
    ),
    "mouthPress": (
        M((14, -55), (30, 8), (1.0, 0.3, 2.7), "upper"),
        M((2, -104), (30, 30), (0.1, 3.4, 1.7), "lower"),
        M((29, -92), (30, 30), (0, 1.8, 1.2)),
        M((5, -59), (17, 25), (-1.0, -1.5, -1.6), "upper"),
    ),
    "mouthSmile": (
        M((17, -106), (30, 29), (0.4, 2.1, 2.2)),
        M((0, -82), (30, 30), (-0.7, 2.8, -1.6), "both"),
        M((37, -82), (25, 21), (0.6, 4.6, -1.1)),
        M((46, -44), (24, 30), (3.9, 4.2, 2.0)),
        M((13, -81), (12, 26), (1.9, -1.3, -1.1), "both"),
        M((26, -74), (11, 23), (2.0, 2.6, -4.3)),
        M((31, -67), (30, 15), (3.7, 2.1, -3.2)),
        F(0.6),
    ),
    "mouthStretch": (
        M((26, -74), (17, 18), (4.5, -2.8, -6.3)),
        M((53, -75), (30, 30), (3.0, 1.3, 1.2)),
        M((16, -93), (30, 16), (0.5, 2.2, -0.1), "lower"),
    ),
    "mouthUpperUp": (
        M((2, -64), (30, 16), (0.7, 3.8, -1.6), "upper"),
        M((0, -70), (29, 17), (-0.2, 4.5, 0.1), "upper"),
        M((22, -54), (14, 17), (1.9, 2.2, -2.1)),
        M((30, -36), (26, 18), (1.4, 3.6, 2.2)),
        M((36, -70), (19, 27), (-0.6, 2.6, 1.6)),
        M((14, -69), (14, 8), (1.1, 0, 1.6), "upper"),
        M((5, -45), (9, 17), (-0.7, -2.4, -0.7), "upper"),
        F(0.8),
    ),
    "noseSneer": (
        M((26, -56), (13, 30), (0, 3.0, -1.5)),
        M((30, -34), (30, 24), (-0.8, 6.9, 2.7)),
        M((3, -64), (30, 14), (0.6, 3.6, -1.8), "upper"),
        M((42, -71), (22, 30), (-1.6, 4.0, 2.9)),
        M((15, 21), (30, 18), (-0.7, -3.4, 0)),
        M((2, -71), (24, 14), (0.5, 4.0, 1.4), "upper"),
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
        F(0.6),
    ),
    "AU11_nasolabial_deepener": (M((28, -49), (11, 11), (-0.3, 1.6, 0.4)), F(0.6)),
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
        M((10, -72), (23, 14), (-1.6, -2.9, 8.6)),
        M((0, -67), (18, 11), (1.9, 8.5, 0.8), "upper"),
        M((0, -79), (18, 30), (1.4, -7.2, -0.3), "lower"),
        M((36, -73), (18, 28), (-2.9, 2.7, 3.1)),
    ),
    "mouthPucker": (
        M((34, -77), (23, 30), (-3.7, 3.1, 5.0)),
        M((7, -73), (27, 15), (-0.9, -0.8, 8.2), "both"),
    ),
    "mouthRollLower": (
        M((0, -79), (18, 12), (-2.4, 4.4, -8.5), "lower"),
        M((0, -88), (30, 13), (0.7, 6.5, 6.5), "lower"),
        M((20, -72), (8, 5), (1.2, -1.9, -2.3), "lower"),
    ),
    "mouthRollUpper": (
        M((0, -73), (30, 7), (0.4, 3.3, -4.5), "upper"),
        M((0, -63), (30, 10), (-0.3, -7.2, -2.6), "upper"),
        M((36, -59), (15, 15), (2.0, 0, -0.3)),
    ),
    "mouthShrugLower": (
        M((0, -75), (30, 14), (1.5, 5.4, 5.6), "lower"),
        M((0, -100), (30, 18), (-1.4, 11.2, 3.9)),
    ),
    "mouthShrugUpper": (
        M((0, -63), (18, 13), (0, 3.7, -0.6), "upper"),
        M((5, -71), (15, 10), (0.3, 3.6, 1.5), "upper"),
    ),
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
