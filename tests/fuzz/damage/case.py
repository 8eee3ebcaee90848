"""From a valid case to a damaged one: a file that only looks like one, or one to two files with
damage inside.
"""

from __future__ import annotations

from collections.abc import Sequence

from fuzz.case import SPECIAL, Case
from fuzz.choice import Choose
from fuzz.damage.archives import Mutator, mangle_tar, mangle_zip
from fuzz.damage.arguments import mangle_arguments
from fuzz.damage.bytes import mangle_bytes
from fuzz.damage.hdf5 import mangle_hdf5
from fuzz.damage.images import mangle_image, mangle_profile
from fuzz.damage.json import mangle_json
from fuzz.damage.pickle import mangle_pickle
from fuzz.damage.text import mangle_mat, mangle_text

BY_SUFFIX: dict[str, Mutator] = {
    "argv": mangle_arguments,
    "json": mangle_json,
    "npz": mangle_zip,
    "zip": mangle_zip,
    "task": mangle_zip,
    "xz": mangle_tar,
    "gz": mangle_tar,
    "pkl": mangle_pickle,
    # The .npy files that are read hold one pickled object.
    "npy": mangle_pickle,
    "h5": mangle_hdf5,
    "mat": mangle_mat,
    "obj": mangle_text,
    "txt": mangle_text,
    "icc": mangle_profile,
    **dict.fromkeys(("png", "jpg", "webp", "tif", "bmp", "exr"), mangle_image),
}


def damaged(
    choose: Choose, seeds: Sequence[Case], fixed: Sequence[str] = (), plain: bool = False
) -> Case:
    """One of ``seeds`` with damage to its files, but to those that ``fixed`` names.

    ``plain``: every file stays a file.
    """
    case = dict(choose.one_of(seeds))
    names = [name for name in case if name not in fixed]
    if choose.chance(60):
        return case
    if not plain and choose.chance(50):
        name = choose.one_of(names)
        del case[name]
        if choose.chance(2):
            case[name + choose.one_of(SPECIAL)] = b""
        return case
    for _ in range(2 if choose.chance(10) else 1):
        name = choose.one_of(names)
        case[name] = BY_SUFFIX.get(name.rpartition(".")[2], mangle_bytes)(choose, case[name])
    return case
