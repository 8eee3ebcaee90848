"""Fits a photo without a window, or animates a film's face: to a .blend, and to pictures in other
light if asked.

Exit codes as the backend's: 0 done, 2 bad input, 3 cancelled, 4 backend unavailable.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    import bpy

from facestage.contract.errors import InputError
from facestage.contract.job import DEFAULT_MODEL, DEVICES, LIGHT_COLORS, MODEL_FORMS
from facestage.contract.light_stage import DEFAULT_COUNT
from facestage.contract.parameters import PARAMETERS
from facestage.contract.person import Person
from facestage.contract.quality import GOOD, QUALITIES, parse_budget
from facestage.contract.sequence import Sequence
from facestage.contract.skin_tone import parse_skin_tone

from ..backend.commands import find_backend
from ..scene.light_setups import LIGHT_FROM
from .additions import ADDITIONS
from .command import exit_code

# What says something of a performance; all else is of a fit.
OF_PERFORMANCE = frozenset(
    {"performance", "out", "simplify", "add", "relight", "expression", "resolution"}
    | {"close_ups", "samples", "export", "texture_size"}
)


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Leave with exit code 2."""
        self.exit(2, f"facestage: {message}\n")


def parser() -> argparse.ArgumentParser:
    """The command line."""
    result = Parser(
        prog="facestage_blender.batch", description="Fit a face to a photo and save it as a .blend."
    )
    _add_photo(result)
    _add_model(result)
    _add_fit(result)
    _add_pictures(result)
    _add_export(result)
    return result


def _add_photo(result: argparse.ArgumentParser) -> None:
    """The options that say what is known of the photo."""
    shown = result.add_mutually_exclusive_group(required=True)
    shown.add_argument(
        "--image",
        type=Path,
        nargs="+",
        help="the photo: PNG, JPEG or EXR; several of one person are fitted together, and the "
        "scene shows the first",
    )
    shown.add_argument(
        "--performance",
        type=Path,
        metavar="DIR",
        help="nothing is fitted: a folder that 'facestage track' wrote becomes an animation",
    )
    result.add_argument(
        "--simplify",
        type=_simplicity,
        metavar="WEIGHT",
        help="of --performance: leave keys out as long as every slider stays so near to the film, "
        "the head's turn within 10 degrees and its place within 100 mm times as much",
    )
    result.add_argument(
        "--out", type=Path, required=True, help="folder for the .blend, the result and the pictures"
    )
    face = result.add_mutually_exclusive_group()
    face.add_argument(
        "--landmarks",
        type=Path,
        nargs="+",
        help="landmark file of the photo (landmarks.json); without it they are detected; one for "
        "each photo",
    )
    face.add_argument(
        "--face",
        type=_face,
        default=1,
        metavar="K",
        help="which face to detect: 1 is the largest (default)",
    )
    lens = result.add_mutually_exclusive_group()
    lens.add_argument(
        "--camera",
        type=Path,
        nargs="+",
        help="camera file of the photo (camera.json); one for each photo, or for all",
    )
    lens.add_argument("--focal-px", type=_positive, help="focal length in pixels")


def _add_model(result: argparse.ArgumentParser) -> None:
    """The options of the face and of the light stage."""
    result.add_argument("--model", default=DEFAULT_MODEL, help=MODEL_FORMS)
    result.add_argument(
        "--rig-blend",
        type=Path,
        metavar="FILE.blend",
        help="a scene with a face mesh of your own, instead of --model",
    )
    result.add_argument("--rig-object", default="", metavar="NAME", help="the mesh in --rig-blend")
    result.add_argument(
        "--lights", type=int, default=DEFAULT_COUNT, help="number of lights on the stage"
    )
    result.add_argument("--light-color", choices=LIGHT_COLORS, default=LIGHT_COLORS[0])


def _add_fit(result: argparse.ArgumentParser) -> None:
    """The options of the fit itself."""
    result.add_argument(
        "--skin-tone",
        type=_skin_tone,
        metavar="TYPE|DEGREES",
        help="how light the skin is: very-light, light, intermediate, tan, brown or dark, or its "
        "typology angle (70 lightest, -80 darkest); without it, a guess",
    )
    result.add_argument(
        "--freeze",
        choices=PARAMETERS,
        nargs="*",
        default=[],
        metavar="NAME",
        help="what not to fit",
    )
    result.add_argument(
        "--budget",
        type=_budget,
        default=(None, GOOD),
        metavar="SECONDS|NAME",
        help=f"seconds that the fit may take, or {', '.join(QUALITIES)}",
    )
    result.add_argument("--seed", type=int, default=0)
    result.add_argument("--device", choices=DEVICES, default=DEVICES[0])
    result.add_argument(
        "--truth",
        type=Path,
        nargs="+",
        help="known truth (.npz), to report errors; one for each photo",
    )
    result.add_argument(
        "--resume", action="store_true", help="go on from the last checkpoint in --out"
    )


def _add_pictures(result: argparse.ArgumentParser) -> None:
    """The options of what the face gets beside the fit, and of the extra pictures."""
    result.add_argument(
        "--add",
        choices=ADDITIONS,
        nargs="*",
        default=[],
        metavar="NAME",
        help="what is not fitted, for close-ups and animators: " + ", ".join(ADDITIONS),
    )
    result.add_argument(
        "--relight",
        choices=sorted(LIGHT_FROM),
        nargs="*",
        default=[],
        help="also render lit from there",
    )
    result.add_argument(
        "--expression",
        type=_weight,
        nargs="*",
        default=[],
        metavar="NAME=VALUE",
        help="render this expression",
    )
    result.add_argument(
        "--resolution", type=int, help="longer side of the extra pictures in pixels"
    )
    result.add_argument(
        "--close-ups",
        type=_side,
        metavar="PIXELS",
        help="also render close-ups of so many pixels a side: eye, mouth, cheek, ear, head, back",
    )
    result.add_argument(
        "--samples", type=int, default=64, help="samples per pixel of the extra pictures"
    )


def _add_export(result: argparse.ArgumentParser) -> None:
    """The options of files for other programs."""
    result.add_argument(
        "--export",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="also save the face for other programs: .glb, .fbx, .usdc or .obj; may be repeated",
    )
    result.add_argument(
        "--texture-size",
        type=_side,
        metavar="PIXELS",
        help="the most pixels along a side of exported textures (default: as fitted)",
    )


def main(arguments: list[str] | None = None) -> int:
    """Do what the command line asks; returns the exit code."""
    options = parser().parse_args(own_arguments() if arguments is None else arguments)
    return exit_code(
        lambda: run(options),
        "Cancelled; --resume goes on from the last checkpoint, if there is one.",
    )


def run(options: argparse.Namespace) -> None:
    """Fit, or animate, save, and render the extra pictures."""
    if options.performance is not None:
        _animate(options)
        return
    if options.simplify is not None:
        raise InputError("--simplify is for the curves of --performance; leave it out.")
    for image in options.image:
        if not image.is_file():
            raise InputError(f"The photo '{image}' does not exist; check the path.")
    count = len(options.image)
    landmarks = _for_each(options.landmarks, "--landmarks", count)
    cameras = _for_each(options.camera, "--camera", count, one_for_all=True)
    truths = _for_each(options.truth, "--truth", count)
    backend = find_backend()
    from ..exchange.export import format_of  # loads Blender
    from ..scene.paths import RESULT_FOLDER
    from . import pipeline

    for path in options.export:
        format_of(path)  # before the fit, which takes a while
    out = options.out.resolve()
    images = [image.resolve() for image in options.image]
    first, *more = map(pipeline.Photo, images, landmarks, cameras, truths)
    order = pipeline.Order(
        image=first.image,
        out=out,
        landmarks=first.landmarks,
        camera=first.camera,
        focal_px=options.focal_px,
        model=options.model,
        lights=options.lights,
        light_color=options.light_color,
        skin_tone=options.skin_tone,
        freeze=tuple(options.freeze),
        budget=options.budget[0],
        quality=options.budget[1],
        seed=options.seed,
        device=options.device,
        truth=first.truth,
        more=tuple(more),
        resume=options.resume,
        face=options.face,
        rig_blend=_resolved(options.rig_blend),
        rig_object=options.rig_object,
        add=tuple(options.add),
    )
    scene = (
        pipeline.empty_scene() if order.rig_blend is None else pipeline.open_scene(order.rig_blend)
    )
    result = pipeline.fit_photo(scene, order, backend, pipeline.progress_printer())
    advice = Person.load(out / RESULT_FOLDER).advice if more else result.advice
    told = f"{advice}\nScene: {out / pipeline.SCENE_FILE}\nResult: {result.folder}"
    _show_more(scene, options, out, told)


def _animate(options: argparse.Namespace) -> None:
    """The film's person and the whole performance, saved."""
    usual = vars(parser().parse_args(["--performance", ".", "--out", "."]))
    for name, value in vars(options).items():
        if name not in OF_PERFORMANCE and value != usual[name]:
            raise InputError(
                f"--performance is not fitted; leave out --{name.replace('_', '-')}, or say it to "
                "facestage track."
            )
    sequence = Sequence.load(options.performance.resolve())
    backend = find_backend()
    from ..exchange.export import format_of  # loads Blender
    from . import pipeline

    for path in options.export:
        format_of(path)
    out, scene = options.out.resolve(), pipeline.empty_scene()
    simplify = options.simplify or 0.0
    on_event = pipeline.progress_printer()
    pipeline.animate(scene, sequence, out, simplify, backend, on_event, tuple(options.add))
    told = f"{sequence.advice}\nScene: {out / pipeline.SCENE_FILE}"
    _show_more(scene, options, out, told)


def _show_more(scene: bpy.types.Scene, options: argparse.Namespace, out: Path, told: str) -> None:
    """Render and export what is asked for beside the scene, and say where all is."""
    from ..exchange.export import export_face

    pictures = _extra_pictures(scene, options, out)
    exported = [
        each for path in options.export for each in export_face(scene, path, options.texture_size)
    ]
    print(told)
    for picture in pictures:
        print(f"Picture: {picture}")
    for file in exported:
        print(f"Exported: {file}")


def own_arguments() -> list[str]:
    """The arguments meant for this program: inside Blender those after ``--``."""
    if "--" in sys.argv:
        return sys.argv[sys.argv.index("--") + 1 :]
    return sys.argv[1:]


def _extra_pictures(scene: bpy.types.Scene, options: argparse.Namespace, out: Path) -> list[Path]:
    from ..pictures.render import render_linear, save_png, srgb
    from ..rig.face_rig import read_weights, require_rig, set_weights
    from ..scene.relight import relight, restore_lights
    from .close_ups import close_ups

    if options.resolution:
        longer = max(scene.render.resolution_x, scene.render.resolution_y)
        scene.render.resolution_percentage = max(1, round(100 * options.resolution / longer))
    pictures = []

    def render(name: str) -> None:
        pixels = render_linear(scene, options.samples)
        save_png(out / f"{name}.png", srgb(pixels[..., :3]))
        pictures.append(out / f"{name}.png")

    for direction in options.relight:
        relight(scene, direction)
        render(f"relit_{direction}")
    restore_lights(scene)
    if options.expression:
        rig = require_rig(scene)
        _, fitted = read_weights(rig)
        set_weights(rig, {}, dict(options.expression))
        render("expression")
        set_weights(rig, {}, fitted)
    if options.close_ups is not None:
        for caption, pixels in close_ups(scene, options.close_ups, options.samples).items():
            pictures.append(out / f"close_{caption.split(',')[0].replace(' ', '_')}.png")
            save_png(pictures[-1], pixels)
    return pictures


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"expected a number greater than 0, found '{text}'")
    return value


def _simplicity(text: str) -> float:
    value = float(text)
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"expected a number from 0 to 1, found '{text}'")
    return value


def _face(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(
            f"expected a whole number, 1 for the largest face, found '{text}'"
        )
    return int(text)


def _side(text: str) -> int:
    if not text.isdecimal() or not 16 <= int(text) <= 8192:
        raise argparse.ArgumentTypeError(f"expected pixels from 16 to 8192, found '{text}'")
    return int(text)


def _budget(text: str) -> tuple[float | None, str]:
    try:
        return parse_budget(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _skin_tone(text: str) -> float:
    try:
        return parse_skin_tone(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _weight(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"expected NAME=VALUE with a number, found '{text}'"
        ) from None


def _for_each(
    paths: list[Path] | None, option: str, photos: int, one_for_all: bool = False
) -> list[Path | None]:
    """A file for each photo. Raises InputError where there are more or fewer."""
    if paths is None:
        return [None] * photos
    if len(paths) == 1 and one_for_all:
        paths = paths * photos
    if len(paths) != photos:
        raise InputError(
            f"{option} names {len(paths)} files for {photos} photos; give one for each, in the "
            "order of the photos."
        )
    return [path.resolve() for path in paths]


def _resolved(path: Path | None) -> Path | None:
    return None if path is None else path.resolve()
