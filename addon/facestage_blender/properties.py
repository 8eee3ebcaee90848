"""What Facestage stores: settings on the scene, marks on its objects, the running fit on the window
manager.
"""

from collections.abc import Sequence

import bpy
import numpy as np
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from facestage.contract.face_model import PARTS
from facestage.contract.job import (
    AUTO,
    DEFAULT_MODEL,
    DEVICES,
    DRAFT_TEXTURE_SIZE,
    LIGHT_COLORS,
    MODEL_FORMS,
    TEXTURE_SIZES,
    USUAL_TEXTURE_SIZE,
    WITH,
    WITHOUT,
)
from facestage.contract.light_stage import (
    DEFAULT_COUNT,
    DEFAULT_RADIUS,
    DEFAULT_SIDE,
    FROZEN,
    OFF,
    ON,
)
from facestage.contract.parameters import TABLE
from facestage.contract.person import PHOTOS_MAX
from facestage.contract.quality import GOOD, QUALITIES, describe
from facestage.contract.skin_tone import (
    ANGLES,
    SKIN_TYPES,
    parse_skin_tone,
    type_angle,
    typology_angle,
    usual_color,
)
from facestage.contract.texture_maps import BESIDE_MAPS, TEXTURE_MAPS

from .translations import FACESTAGE

LIGHT_STATES = {"ON": ON, "FROZEN": FROZEN, "OFF": OFF}
LANDMARK_SOURCES = {
    "FILE": ("From a File", "The landmarks come from a file that was chosen"),
    "DETECTED": ("Detected", "The landmarks were found by Detect Landmarks"),
    "EDITED": ("Edited", "The landmarks were edited by hand"),
}
PART_HELP = {
    "skin": "Skin: its color is fitted",
    "eyes": "Eyeballs",
    "mouth": "Gums, tongue and the inside of the mouth",
    "teeth": "Teeth",
    "other": "Lashes, tear films, hair, clothes: the fit does not look at them",
}
# What the skin tone may be beside one of the types.
FROM_PHOTO, BY_ANGLE = "PHOTO", "ANGLE"
DEVICE_NAMES = {"auto": "Automatic", "cpu": "CPU", "cuda": "NVIDIA GPU"}

# Newer Blenders want to be told which paths may begin with "//", the .blend's folder.
RELATIVE = (
    {"PATH_SUPPORTS_BLEND_RELATIVE"}
    if "is_path_supports_blend_relative" in bpy.types.Property.bl_rna.properties
    else set()
)


def _sentence(words: str) -> str:
    """``words`` with a capital first letter; "dB" stays as it is."""
    return words[:1].upper() + words[1:]


def _title(words: str) -> str:
    """``words`` as Blender writes labels."""
    return " ".join(word if word in {"in", "mm"} else _sentence(word) for word in words.split())


def _on_light_state(owner: "LightSettings", _context: bpy.types.Context) -> None:
    """An off light is hidden everywhere, so that its radiance is exactly 0; its power is kept for
    later.
    """
    light = owner.id_data
    light.hide_render = light.hide_viewport = owner.state == "OFF"


def _on_landmark_state(owner: "LandmarkSettings", _context: bpy.types.Context) -> None:
    """A landmark's empty looks like its state."""
    empty = owner.id_data
    empty.empty_display_type = "PLAIN_AXES" if owner.state == "IGNORED" else "SPHERE"
    empty.empty_display_size = owner.size * (0.55 if owner.state == "HIDDEN" else 1.0)


def _usual_color(owner: "OfFace") -> tuple[float, float, float]:
    """Of the skin that is said; a mean one's where none is."""
    angle = owner.known_skin_tone()
    return usual_color(type_angle("intermediate") if angle is None else angle)


def _say_color(owner: "OfFace", color: Sequence[float]) -> None:
    """Make the tone that of a skin of this ``color``."""
    owner.skin_angle = float(np.clip(typology_angle(np.array(color)), *ANGLES))
    owner.skin_tone = BY_ANGLE


def _is_mesh(_owner: object, candidate: bpy.types.Object) -> bool:
    return candidate.type == "MESH"


def _is_armature(_owner: object, candidate: bpy.types.Object) -> bool:
    return candidate.type == "ARMATURE"


class LightSettings(bpy.types.PropertyGroup):
    """What the fit may do with one light of the stage."""

    index: IntProperty(
        name="Index", description="Place of the light on the stage's lattice", default=-1
    )
    state: EnumProperty(
        name="State",
        description="What the fit does with this light",
        items=[
            ("ON", "Fitted", "The fit finds the light's color and power", "LIGHT_AREA", ON),
            ("FROZEN", "Frozen", "The light keeps its color and power", "FREEZE", FROZEN),
            ("OFF", "Off", "The light is dark and the fit leaves it out", "HIDE_ON", OFF),
        ],
        default="ON",
        update=_on_light_state,
    )
    fitted_radiance: FloatVectorProperty(
        name="Fitted Radiance",
        description="What the last fit found, to return to after relighting",
        size=3,
    )


class FaceSettings(bpy.types.PropertyGroup):
    """Marks a mesh as a face rig."""

    is_rig: BoolProperty(name="Face Rig", description="This mesh was built by Facestage")
    model: StringProperty(name="Face Model", description="The face model this rig was built from")
    roughness: FloatProperty(
        name="Roughness", description="Roughness of the skin as last fitted", default=0.45
    )
    control_rig: PointerProperty(
        type=bpy.types.Object,
        name="Control Rig",
        description="The armature whose handles move the face",
        poll=_is_armature,
    )
    placed_for: StringProperty(
        name="Placed for",
        description="The face at rest that the handles were placed for, as a digest",
        options={"HIDDEN"},
    )
    own_mesh: StringProperty(
        name="Own Mesh", description="How a mesh of the user's is tied to its face model"
    )
    fit_shape: BoolProperty(
        name="Fit the Face's Shape",
        description="The fit may give the mesh the shape of the face in the photo. Where the "
        "mesh has no identity "
        "sliders, the shape is borrowed from the default face and written to one new shape "
        "key, Facestage Shape",
        default=True,
    )
    identity_prefix: StringProperty(
        name="Identity Sliders",
        description="Shape keys whose names begin so change who the face is; all others are "
        "expressions",
        default="identity",
    )
    own_materials: BoolProperty(
        name="Facestage Skin",
        description="Give face, eyes and mouth Facestage's material with the fitted textures. "
        "Your materials stay in "
        "the file; off: they stay on the mesh",
        default=True,
    )


# The image of each texture map, as NAME_image.
FaceSettings.__annotations__ |= {
    f"{each.name}_image": PointerProperty(
        type=bpy.types.Image,
        name=_title(each.title),
        description=f"{_title(each.title)} texture, linear",
    )
    for each in (*TEXTURE_MAPS, *BESIDE_MAPS)
}


class LandmarkSettings(bpy.types.PropertyGroup):
    """Marks an empty as a landmark on the photo."""

    index: IntProperty(
        name="Index", description="Place of the landmark in its scheme; -1: no landmark", default=-1
    )
    size: FloatProperty(name="Size", description="Size at which a visible landmark is drawn")
    state: EnumProperty(
        name="State",
        description="What the fit makes of this landmark",
        items=[
            ("VISIBLE", "Visible", "The photo shows this point of the face", "HIDE_OFF", 0),
            (
                "HIDDEN",
                "Hidden",
                "Something hides this point: where it is was guessed, and counts less",
                "HIDE_ON",
                1,
            ),
            ("IGNORED", "Ignored", "The fit does not look at this landmark", "X", 2),
        ],
        default="VISIBLE",
        update=_on_landmark_state,
    )


class OfPhoto:
    """What is known of a photo.

    Photo, landmarks and result are plain strings, because some versions of Blender change what
    they know for a path when a file is saved elsewhere, and some do not: scene/keeping.py does.
    """

    photo: StringProperty(name="Photo", description="The photo to fit")
    landmarks: StringProperty(
        name="Landmarks",
        description="Landmark file of the photo (landmarks.json). Empty: the fit finds them "
        "by itself",
    )
    landmarks_from: EnumProperty(
        name="Landmarks from",
        description="Where the landmarks come from",
        items=[(name, *texts) for name, texts in LANDMARK_SOURCES.items()],
    )
    face_number: IntProperty(
        name="Face",
        description="Which face of the photo: 1 is the largest",
        default=1,
        min=1,
        soft_max=10,
        translation_context=FACESTAGE,
    )
    white_balance_known: BoolProperty(
        name="White Balance",
        description="The color of the light is known from something grey in the photo; otherwise "
        "it is a guess, and the skin's color with it",
    )
    white_balance: FloatVectorProperty(
        name="Color of the Light",
        description="What something grey or white shows in the photo; how bright it is does not "
        "matter",
        subtype="COLOR",
        default=(1.0, 1.0, 1.0),
        min=1e-3,
        soft_max=1.0,
    )
    known_lens: BoolProperty(
        name="Known Lens",
        description="The scene camera's focal length and shift are those of the photo; "
        "otherwise they are guessed",
    )
    result: StringProperty(name="Result", description="Folder of the photo's last result")
    pins: StringProperty(
        name="Pins", description="Points of the face that were put on the photo by hand"
    )


class PhotoSettings(OfPhoto, bpy.types.PropertyGroup):
    """One of several photos of the person, as it was when another one came to be shown."""

    # The lens, under the names that Blender's cameras have for it.
    lens: FloatProperty(name="Focal Length", description="In millimetres", default=50.0)
    sensor_width: FloatProperty(name="Sensor Width", description="In millimetres", default=36.0)
    sensor_height: FloatProperty(name="Sensor Height", description="In millimetres", default=24.0)
    sensor_fit: StringProperty(
        name="Sensor Fit", description="Which side of the sensor is the picture's", default="AUTO"
    )
    shift_x: FloatProperty(name="Shift X", description="Of the lens, in widths")
    shift_y: FloatProperty(name="Shift Y", description="Of the lens, in widths")
    advice: StringProperty(name="Advice", description="What the last fit says of this photo")
    doubtful: BoolProperty(
        name="Doubtful", description="The last fit did not simply believe this photo"
    )


class OfFace(OfPhoto):
    """The job of one face as the user has set it up, and where its result went; of several photos,
    that of the one that is shown.
    """

    folder: StringProperty(
        name="Folder",
        description="Where in the output folder the files of this face go, if it is not the only "
        "one of the scene",
    )
    photos: CollectionProperty(
        type=PhotoSettings,
        name="Photos",
        description="All photos of the person, where there are several",
    )
    photo_number: IntProperty(
        name="Photo",
        description="Which of several photos is shown",
        default=1,
        min=1,
        max=PHOTOS_MAX,
    )
    performance: StringProperty(
        name="Performance", description="Folder of the performance that was imported last"
    )
    performance_start: FloatProperty(
        name="Start", description="Frame at which the performance was imported"
    )
    performance_simplify: FloatProperty(
        name="Simplify", description="How far its curves may be from the film"
    )
    performance_mark: StringProperty(
        name="Mark", description="Changes when the performance's folder does"
    )
    stage: PointerProperty(
        type=bpy.types.Object,
        name="Light Stage",
        description="The empty that carries the light stage",
    )
    rig: PointerProperty(
        type=bpy.types.Object, name="Face Rig", description="The face that is fitted", poll=_is_mesh
    )
    landmark_plane: PointerProperty(
        type=bpy.types.Object,
        name="Photo Plane",
        description="Carries the landmarks' empties while they are edited",
    )
    pinning: BoolProperty(
        name="Pinning", description="The face is shown as a wireframe that can be dragged"
    )
    model: StringProperty(
        name="Face Model",
        description=f"As the backend calls it: {MODEL_FORMS}",
        default=DEFAULT_MODEL,
    )
    light_count: IntProperty(
        name="Lights",
        description="Number of area lights on the hemisphere",
        default=DEFAULT_COUNT,
        min=1,
        soft_max=200,
        max=10000,
        translation_context=FACESTAGE,
    )
    light_radius: FloatProperty(
        name="Radius",
        description="Distance of the lights from the face",
        default=DEFAULT_RADIUS,
        min=0.2,
        soft_max=10,
        unit="LENGTH",
    )
    light_side: FloatProperty(
        name="Size",
        description="Side of each square light",
        default=DEFAULT_SIDE,
        min=0.001,
        soft_max=2,
        unit="LENGTH",
    )
    light_color: EnumProperty(
        name="Light Color",
        description="Whether the lights may differ in color",
        items=[
            (LIGHT_COLORS[0], "Each Its Own", "Every light has a color of its own"),
            (LIGHT_COLORS[1], "One for All", "All lights share one color and differ in power only"),
        ],
    )
    surround: EnumProperty(
        name="Light Behind",
        description="Whether the fit adds lights behind the face to those of the stage",
        items=[
            (AUTO, "Where Needed", "Lights behind the face where the photo shows light from there"),
            (WITH, "Always", "Lights behind the face, whatever the photo shows"),
            (WITHOUT, "Never", "The lights of the stage alone"),
        ],
    )
    skin_tone: EnumProperty(
        name="Skin Tone",
        description="How light the skin is, which a photo alone hardly tells from the light: if "
        "it came out too light or too dark, say what it is and fit again",
        items=[
            (FROM_PHOTO, "From the Photo", "A guess by the photo's exposure, eyes and highlights")
        ]
        + [
            (
                name.upper().replace(" ", "_"),
                _title(f"{name} skin"),
                f"An individual typology angle of about {type_angle(name):.0f}°",
            )
            for name, _ in SKIN_TYPES
        ]
        + [(BY_ANGLE, "By Its Angle", "The individual typology angle, in degrees")],
    )
    skin_angle: FloatProperty(
        name="Typology Angle",
        description="The skin's individual typology angle in degrees: 55 and more is very light, "
        "-30 and less dark",
        default=type_angle("intermediate"),
        min=ANGLES[0],
        max=ANGLES[1],
        precision=0,
        step=100,
    )
    texture_size: EnumProperty(
        name="Textures",
        description="The most pixels along the textures of the next fit; as many as the photo "
        "fills are made",
        items=[
            (
                "0",
                "As Usual",
                f"Textures of {USUAL_TEXTURE_SIZE} pixels at most, of a draft {DRAFT_TEXTURE_SIZE}",
            ),
            *(
                (str(size), str(size), f"Textures of {size} pixels at most")
                for size in TEXTURE_SIZES
            ),
        ],
    )
    exposure_known: BoolProperty(
        name="Exposure Known",
        description="Whether lights that are frozen are as bright as the photo shows them; else "
        "the fit finds the one factor that their brightness lacks",
        default=True,
    )
    freeze: EnumProperty(
        name="Keep as Is",
        description="What the fit must not change",
        items=[
            (name, _title(name.replace("_", " ")), parameter.keep, "NONE", 1 << bit)
            for bit, (name, parameter) in enumerate(TABLE.items())
        ],
        options={"ENUM_FLAG"},
        translation_context=FACESTAGE,
    )
    start_from_rig: BoolProperty(
        name="Start from the Rig",
        description="Start the fit at the rig's present sliders instead of the mean face",
    )
    pin_focal: BoolProperty(
        name="Find Focal Length",
        description="Pins find the focal length, too, from the next drag on: a dozen or more, all "
        "over the face. The face goes as much further away, and shows as large as before",
    )
    keep_camera: BoolProperty(
        name="Keep Camera",
        description="Leave the scene's camera where it is and move the head; otherwise the "
        "camera is placed by the fit",
    )
    weight_photo: FloatProperty(
        name="Photo", description="Trust in the photo's pixels", default=1, min=0, soft_max=10
    )
    weight_landmarks: FloatProperty(
        name="Landmarks", description="Trust in the landmarks", default=1, min=0, soft_max=10
    )
    weight_prior: FloatProperty(
        name="Prior", description="Pull towards the mean face", default=1, min=0, soft_max=10
    )
    weight_light: FloatProperty(
        name="Light", description="Pull towards white light", default=1, min=0, soft_max=10
    )
    quality: EnumProperty(
        name="Quality",
        description="How far the fit goes",
        items=[(name, name.capitalize(), _sentence(describe(name))) for name in QUALITIES],
        default=GOOD,
    )
    budget: FloatProperty(
        name="Budget",
        description="Time for the fit; 0 is no limit",
        default=0,
        min=0,
        unit="TIME_ABSOLUTE",
    )
    seed: IntProperty(name="Seed", description="Seed of the random numbers", default=0, min=0)
    device: EnumProperty(
        name="Device",
        description="Where the fit computes",
        items=[(name, DEVICE_NAMES[name], f"Compute on: {DEVICE_NAMES[name]}") for name in DEVICES],
    )
    output: StringProperty(
        name="Output",
        description="Folder for the job and the result. Empty: beside the .blend, or a "
        "temporary folder",
        subtype="DIR_PATH",
        options=RELATIVE,
    )

    def known_skin_tone(self) -> float | None:
        """The typology angle of the skin in degrees; None: the photo has to say it."""
        if self.skin_tone == FROM_PHOTO:
            return None
        if self.skin_tone == BY_ANGLE:
            return float(self.skin_angle)
        return parse_skin_tone(self.skin_tone)


class StoredFace(OfFace, bpy.types.PropertyGroup):
    """One of several faces of a scene, as it was when another one came to be shown."""

    camera: PointerProperty(
        type=bpy.types.Object, name="Camera", description="The camera of the face's photo"
    )


class SceneSettings(OfFace, bpy.types.PropertyGroup):
    """The face that the panel shows, and all faces of the scene where there are several."""

    camera_before: PointerProperty(
        type=bpy.types.Object,
        name="Camera Before",
        description="The camera that the scene had before the photo",
    )
    photo_camera: PointerProperty(
        type=bpy.types.Object,
        name="Photo's Camera",
        description="The camera of the photo while the scene has its own again",
    )
    view_before: StringProperty(
        name="View Before", description="Resolution and colors that the scene had before the photo"
    )
    world_before: PointerProperty(
        type=bpy.types.World,
        name="World Before",
        description="The world that was put out of the way",
    )
    faces: CollectionProperty(
        type=StoredFace, name="Faces", description="All faces of the scene, where there are several"
    )
    face_shown: IntProperty(
        name="Face", description="Which of several faces the panel is about", default=1, min=1
    )
    skin_color: FloatVectorProperty(
        name="Usual Color",
        description="What skin of this tone usually looks like; choose another color, and its "
        "typology angle counts. The hue is fitted",
        subtype="COLOR",
        size=3,
        min=0,
        max=1,
        get=_usual_color,
        set=_say_color,
    )


class RunState(bpy.types.PropertyGroup):
    """The process at work, as the panel shows it. Lives on the window manager: it is not saved."""

    task: StringProperty(name="Task", description="What is running; empty when nothing is")
    stage: StringProperty(name="Stage", description="Stage of the fit")
    verdict: StringProperty(name="Verdict", description="What the last fit says of its result")
    doubtful: BoolProperty(
        name="Doubtful", description="The last fit did not simply converge: its verdict says why"
    )
    began: StringProperty(name="Began", description="What runs, or was the last to run")
    failure: StringProperty(name="Error", description="Why the last run ended without a result")
    notice: StringProperty(
        name="Notice", description="Why the last run ended without a result, where nothing is wrong"
    )
    fraction: FloatProperty(
        name="Progress", description="Share of the work done", min=0, max=1, subtype="FACTOR"
    )
    photo_error: FloatProperty(
        name="Photo Error",
        description="Root mean square difference to the photo, linear",
        default=-1,
    )
    seconds_left: FloatProperty(
        name="Time Left", description="Estimate of the seconds left", default=-1
    )
    cancel: BoolProperty(name="Cancel", description="Set to ask the running process to stop")


class PreviewState(bpy.types.PropertyGroup):
    """The live relight preview, as the panel shows it.

    Lives on the window manager: neither saved nor undone.
    """

    active: BoolProperty(name="Active", description="The relight preview is on")
    status: StringProperty(
        name="Status", description="Why the preview shows the photo as it is; empty when it follows"
    )


CLASSES = (
    LightSettings,
    FaceSettings,
    LandmarkSettings,
    PhotoSettings,
    StoredFace,
    SceneSettings,
    RunState,
    PreviewState,
)


def attach() -> None:
    """Add the property groups to Blender's types; the classes are registered already."""
    bpy.types.Object.facestage_light = PointerProperty(type=LightSettings)
    bpy.types.Object.facestage_face = PointerProperty(type=FaceSettings)
    bpy.types.Object.facestage_landmark = PointerProperty(type=LandmarkSettings)
    bpy.types.Material.facestage_part = EnumProperty(
        name="Part of the Face",
        description="What this material covers",
        items=[("AUTO", "By Name", "As the material's name says, else skin")]
        + [(part.upper(), part.capitalize(), PART_HELP[part]) for part in PARTS],
    )
    bpy.types.Scene.facestage = PointerProperty(type=SceneSettings)
    bpy.types.WindowManager.facestage = PointerProperty(type=RunState)
    bpy.types.WindowManager.facestage_preview = PointerProperty(type=PreviewState)


def detach() -> None:
    """Undo :func:`attach`."""
    del bpy.types.WindowManager.facestage_preview
    del bpy.types.WindowManager.facestage
    del bpy.types.Scene.facestage
    del bpy.types.Object.facestage_landmark
    del bpy.types.Material.facestage_part
    del bpy.types.Object.facestage_face
    del bpy.types.Object.facestage_light
