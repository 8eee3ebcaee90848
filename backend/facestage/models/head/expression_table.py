"""What each muscle group does to the face: Gaussian pulls in the front view, written for the left side."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Muscle:
    """Displacement `move` (outward, up, forward; mm) times a Gaussian about `center` (x, y; mm) of `radii` (mm).

    lip: "" moves all skin there, "upper" or "lower" only that side of the mouth line, "both" both lips.
    """

    center: tuple[float, float]
    radii: tuple[float, float]
    move: tuple[float, float, float]
    lip: str = ""


M = Muscle
_CORNER = (25.0, -73.0)

# One-sided shapes: made twice, for the left and for the right.
ONE_SIDED: dict[str, tuple[Muscle, ...]] = {
    "browDown": (M((18, 20), (12, 10), (-2.4, -5.0, -0.3)), M((38, 20), (16, 9), (-1.0, -3.4, 0.3))),
    "browOuterUp": (M((42, 21), (15, 14), (0.4, 6.5, -1.6)), M((42, 38), (18, 16), (0, 2.4, -0.5))),
    "cheekSquint": (M((36, -20), (18, 13), (0.6, 4.6, 2.2)), M((46, -6), (10, 8), (-0.8, 1.6, 0.8))),
    "eyeBlink": (),
    "eyeLookDown": (),
    "eyeLookIn": (),
    "eyeLookOut": (),
    "eyeLookUp": (),
    "eyeSquint": (M((33, -13), (15, 7), (0, 1.6, 0.5)),),
    "eyeWide": (M((32, 14), (15, 8), (0, 1.2, 0)),),
    "mouthDimple": (M(_CORNER, (11, 11), (3.2, 0.6, -3.2)),),
    "mouthFrown": (M(_CORNER, (13, 12), (1.0, -6.5, -1.4)), M((22, -86), (13, 10), (0.6, -2.4, 0))),
    "mouthLowerDown": (M((9, -80), (14, 11), (0.7, -5.6, -0.5), "lower"), M((13, -94), (14, 10), (0.4, -2.4, 0.5))),
    "mouthPress": (M((14, -67), (13, 6), (0, -1.8, -1.2), "upper"), M((14, -80), (13, 7), (0, 2.4, -1.4), "lower")),
    "mouthSmile": (
        M(_CORNER, (14, 13), (6.4, 6.2, -4.2)), M((5, -71), (15, 11), (1.0, 4.2, -1.0), "upper"),
        M((5, -77), (15, 10), (0.8, 1.2, -1.4), "lower"), M((0, -73), (12, 11), (0, 1.2, 0), "both"),
        M((40, -42), (17, 15), (1.6, 3.6, 2.8)), M((34, -16), (14, 8), (0, 1.2, 0.8)),
    ),
    "mouthStretch": (M(_CORNER, (14, 14), (6.2, -3.4, -3.6)), M((32, -92), (16, 16), (1.8, -2.2, -0.6))),
    "mouthUpperUp": (M((9, -68), (14, 9), (0.5, 4.6, 0.2), "upper"), M((20, -52), (11, 11), (0.6, 2.6, 0.8))),
    "noseSneer": (
        M((16, -46), (8, 9), (1.0, 3.8, 0.2)), M((9, -16), (8, 12), (-0.4, 2.2, 0.7)),
        M((13, -66), (10, 8), (0, 2.2, 0), "upper"), M((15, 14), (9, 8), (-1.0, -1.6, 0)),
    ),
    "AU1_inner_brow_raiser": (M((13, 22), (9, 12), (0.4, 6.4, -0.4)), M((14, 40), (14, 15), (0, 2.4, 0))),
    "AU4_brow_gatherer": (M((14, 19), (10, 8), (-4.2, -1.2, 0.9)), M((5, 14), (6, 7), (-0.8, 0, 0.6))),
    "AU46_wink": (
        M((36, -18), (18, 14), (0.4, 5.2, 2.2)), M((26, 20), (16, 9), (-0.8, -2.6, 0.2)),
        M(_CORNER, (13, 12), (2.0, 3.0, -1)),
    ),
    "AU7_lower_lid_raiser": (M((44, 2), (9, 8), (-0.6, 0, 0)),),
    "lower_lid_lower": (M((32, -13), (13, 7), (0, -1.4, 0)),),
    "AU10_upper_lip_raiser": (M((16, -60), (10, 11), (0.6, 4.8, 1.2), "upper"), M((30, -38), (13, 11), (0, 2.8, 1.6))),
    "AU11_nasolabial_deepener": (M((23, -52), (6, 10), (0, 1.6, -1.8)), M((32, -47), (9, 11), (-0.6, 1.6, 2.0))),
    "AU13_sharp_lip_puller": (M(_CORNER, (9, 9), (2.0, 7.0, -1.4)), M((38, -50), (12, 12), (0, 2.2, 2.8))),
    "AU16_lower_lip_depressor": (M((15, -84), (12, 9), (2.4, -4.4, 1.6), "lower"),),
    "AU31_jaw_clencher": (M((55, -64), (12, 17), (4.0, 0, 0.6)), M((60, 22), (12, 13), (1.4, 0, 0.3))),
    "AU33_cheek_blow": (M((42, -66), (19, 17), (6.4, 0, 6.4)), M((24, -64), (11, 9), (0.6, 0, 1.8), "upper")),
    "AU35_cheek_suck": (M((42, -66), (16, 16), (-4.8, 0, -5.0)),),
    "AU38_nostril_dilator": (M((15, -48), (6, 7), (2.4, 0.8, 0.4)),),
}  # fmt: skip

# Shapes of both sides at once.
BOTH: dict[str, tuple[Muscle, ...]] = {
    "browInnerUp": (M((14, 21), (14, 13), (0, 7.0, -0.6)), M((13, 40), (20, 17), (0, 3.0, -0.2))),
    "cheekPuff": (M((42, -64), (20, 19), (7.0, 0, 7.0)), M((14, -62), (14, 8), (0, 0, 2.4), "upper"),
                  M((14, -88), (14, 9), (0, 0, 2.4), "lower")),
    "mouthFunnel": (
        M(_CORNER, (12, 13), (-6.6, 0, 4.6)), M((0, -66), (14, 7), (0, 3.4, 5.4), "upper"),
        M((0, -81), (14, 8), (0, -3.6, 5.6), "lower"),
    ),
    "mouthPucker": (M(_CORNER, (13, 14), (-9.4, 0, 6.4)), M((12, -73), (9, 12), (-2.6, 0, 4.6), "both")),
    "mouthRollLower": (M((0, -80), (21, 6.5), (0, 3.2, -5.0), "lower"), M((0, -93), (20, 8), (0, 2.0, 0.6), "lower")),
    "mouthRollUpper": (M((0, -68), (21, 5.0), (0, -2.6, -4.6), "upper"), M((0, -58), (18, 6), (0, -1.4, 0.5), "upper")),
    "mouthShrugLower": (M((0, -82), (19, 11), (0, 4.4, 2.6), "lower"), M((0, -105), (18, 11), (0, 3.4, 0.6))),
    "mouthShrugUpper": (M((0, -66), (19, 9), (0, 4.0, 2.6), "upper"),),
    "AU9_nose_wrinkler": (M((5, -20), (10, 11), (0, 3.6, 0.6)), M((13, 14), (11, 9), (-1.2, -3.2, 0.2)),
                          M((16, -47), (9, 8), (0.4, 2.2, 0))),
    "AU17_chin_raiser": (M((0, -101), (17, 11), (0, 5.6, 1.2)), M((0, -92), (16, 7), (0, 1.6, 2.0))),
    "AU22_upper_lip_funnel": (M((0, -66), (16, 7), (0, 3.2, 4.2), "upper"),),
    "AU22_lower_lip_funnel": (M((0, -82), (16, 8), (0, -3.6, 4.4), "lower"),),
    "AU23_lip_tightener": (
        M((0, -67), (20, 5), (0, -2.2, -1.0), "upper"), M((0, -80), (20, 6), (0, 2.4, -1.0), "lower"),
        M(_CORNER, (9, 9), (-1.6, 0, -0.6)),
    ),
    "AU25_lips_part": (M((0, -69), (19, 8), (0, 1.6, 0), "upper"), M((0, -80), (19, 10), (0, -3.4, 0), "lower")),
    "AU39_nostril_compressor": (M((15, -48), (7, 8), (-2.0, 0, 0.4)), M((0, -44), (8, 8), (0, -1.2, 0))),
    "AU21_neck_tightener": (M((34, -125), (22, 26), (2.4, -2.6, 3.4)), M((30, -92), (17, 14), (1.2, -2.4, 0))),
    "swallow": (M((0, -150), (12, 15), (0, 8.0, 0.4)), M((0, -126), (20, 11), (0, -2.0, 1.2))),
    "viseme_F": (M((0, -79), (18, 7), (0, 3.0, -6.0), "lower"), M((0, -67), (18, 6), (0, 1.8, 0.4), "upper")),
    "viseme_M": (M((0, -68), (22, 5), (0, -1.8, -2.6), "upper"), M((0, -79), (22, 6), (0, 1.4, -2.8), "lower")),
}  # fmt: skip
