"""The table of readers: what each is fed, how often, and which modules it covers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from fuzz.case import Case
from fuzz.readers import command, files, models
from fuzz.seeds import contract as seeds_contract
from fuzz.seeds import fit as seeds_fit
from fuzz.seeds import images as seeds_images
from fuzz.seeds import models as seeds_models
from fuzz.target import Target

CONTRACT, MODELS = "facestage.contract", "facestage.models"


def _target(
    name: str,
    covers: str,
    seeds: Callable[[], list[Case]],
    read: Callable[[Path], None],
    share: int,
    **options: Any,
) -> Target:
    return Target(name, tuple(covers.split()), seeds, read, share, **options)


_RESULT_FILES = ("result.json", "result.npz", "albedo.exr", "specular.exr", "roughness.exr")
TARGETS = {
    target.name: target
    for target in (
        _target(
            "json",
            f"{CONTRACT}.files.storage {CONTRACT}.files.reading {CONTRACT}.files.json_text",
            seeds_contract.any_json,
            files.read_any_json,
            60,
        ),
        _target(
            "arrays",
            f"{CONTRACT}.files.storage {CONTRACT}.files.array_archive",
            seeds_contract.any_arrays,
            files.read_any_arrays,
            120,
        ),
        _target("job", f"{CONTRACT}.job", seeds_contract.job_folders, files.read_job, 90),
        _target(
            "result", f"{CONTRACT}.result", seeds_contract.result_folders, files.read_result, 90
        ),
        _target(
            "person", f"{CONTRACT}.person", seeds_contract.person_folders, files.read_person, 60
        ),
        _target(
            "sequence",
            f"{CONTRACT}.sequence",
            seeds_contract.sequence_folders,
            files.read_sequence,
            60,
        ),
        _target(
            "corrections",
            f"{CONTRACT}.corrections",
            seeds_contract.corrections_files,
            files.read_corrections,
            40,
        ),
        _target(
            "sequence-truth",
            "facestage.fit.sequence.sequence_truth",
            seeds_contract.sequence_truths,
            files.read_sequence_truth,
            40,
        ),
        _target(
            "landmarks",
            f"{CONTRACT}.landmarks",
            seeds_contract.landmark_files,
            files.read_landmarks,
            50,
        ),
        _target("camera", f"{CONTRACT}.camera", seeds_contract.camera_files, files.read_camera, 40),
        _target(
            "live-link",
            f"{CONTRACT}.live_link",
            seeds_contract.recordings,
            files.read_live_link,
            40,
        ),
        _target(
            "manifest",
            "facestage.batch.manifest",
            seeds_contract.manifests,
            files.read_manifest,
            40,
        ),
        _target("journal", f"{CONTRACT}.batch", seeds_contract.journals, files.read_journal, 30),
        _target(
            "reflectance",
            f"{CONTRACT}.reflectance",
            seeds_contract.reflectance_fields,
            files.read_reflectance,
            40,
        ),
        _target(
            "event",
            f"{CONTRACT}.events",
            seeds_contract.event_lines,
            files.read_event,
            40,
            plain=True,
        ),
        _target(
            "relight",
            f"{CONTRACT}.relight_cache",
            seeds_contract.relit_folders,
            files.read_relight,
            40,
            fixed=_RESULT_FILES,
        ),
        _target(
            "render",
            "facestage.fit.result.relight facestage.cli",
            seeds_contract.render_folders,
            command.read_render,
            30,
        ),
        _target(
            "rig-file", f"{CONTRACT}.rig_file", seeds_contract.rig_files, files.read_rig_file, 50
        ),
        _target("rig", f"{MODELS}.loaders.rig", seeds_contract.rig_files, models.read_rig, 1),
        _target(
            "face-model",
            f"{CONTRACT}.face_model {MODELS}.registry",
            seeds_contract.face_models,
            models.read_face_model,
            40,
        ),
        _target(
            "truth", "facestage.fit.given.truth", seeds_contract.truth_files, files.read_truth, 40
        ),
        _target("scan", f"{CONTRACT}.scan", seeds_contract.scan_files, files.read_scan, 40),
        _target(
            "memory", "facestage.system.native", seeds_contract.memories, files.read_memory, 30
        ),
        _target(
            "checkpoint",
            "facestage.fit.runs.checkpoint",
            seeds_fit.checkpoints,
            files.read_checkpoint,
            30,
        ),
        _target(
            "joint-checkpoint",
            "facestage.fit.runs.joint_checkpoint",
            seeds_fit.joint_checkpoints,
            files.read_joint_checkpoint,
            20,
        ),
        _target(
            "pickle",
            f"{MODELS}.files.restricted_pickle",
            seeds_models.pickles,
            models.read_pickled,
            100,
        ),
        _target(
            "flame", f"{MODELS}.loaders.flame", seeds_models.flame_files, models.read_flame, 20
        ),
        _target(
            "flame-whole",
            f"{MODELS}.loaders.flame {MODELS}.correspondence.embedding",
            seeds_models.whole_flame,
            models.read_flame,
            1,
        ),
        _target(
            "bfm",
            f"{MODELS}.loaders.bfm {MODELS}.files.hdf5_file facestage.system.in_child",
            seeds_models.bfm_files,
            models.read_bfm,
            6,
        ),
        _target(
            "bfm-mat",
            f"{MODELS}.loaders.bfm {MODELS}.files.mat_file facestage.system.in_child",
            seeds_models.mat_files,
            models.read_bfm,
            8,
        ),
        _target(
            "gnm",
            f"{MODELS}.loaders.gnm {MODELS}.files.published_file",
            seeds_models.gnm_files,
            models.read_gnm,
            4,
        ),
        _target(
            "ict",
            f"{MODELS}.loaders.ict {MODELS}.files.obj_text {MODELS}.files.published_archive",
            seeds_models.ict_files,
            models.read_ict,
            8,
        ),
        _target("bomb", "", seeds_models.bombs, models.read_bomb, 1, warm=False),
        _target(
            "bundle", "facestage.landmarks.model_file", seeds_models.bundles, models.read_bundle, 10
        ),
        _target(
            "geometry",
            "facestage.landmarks.canonical",
            seeds_models.geometry_messages,
            models.read_geometry,
            30,
            plain=True,
        ),
        _target(
            "photo", "facestage.images.image_io", seeds_images.photographs, models.read_photo, 110
        ),
        _target(
            "exr",
            f"facestage.images.image_io facestage.images.exr_pixels {CONTRACT}.files.exr_header",
            seeds_images.exr_photographs,
            models.read_photo,
            60,
        ),
        _target(
            "profile",
            "facestage.images.color_profile",
            seeds_images.profiles,
            models.read_profile,
            50,
            refusals=(ValueError,),
            plain=True,
        ),
        _target(
            "exif",
            "facestage.images.exif",
            seeds_images.exif_blocks,
            models.read_exif,
            30,
            plain=True,
        ),
        _target(
            "command",
            "facestage.cli facestage.cli.render facestage.cli.streams",
            seeds_fit.command_lines,
            command.run_command,
            12,
        ),
    )
}


def counts(inputs: int) -> dict[str, int]:
    """How many of ``inputs`` each target gets; at least one."""
    total = sum(target.share for target in TARGETS.values())
    return {name: max(1, round(inputs * target.share / total)) for name, target in TARGETS.items()}
