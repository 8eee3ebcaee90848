"""Chooses Mitsuba's variant once per process, before anything of it is used."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import mitsuba as mi

from facestage.system.native import LLVM_VARIANT, choose_variant, ensure_llvm


def start_renderer(device: str = "auto") -> str:
    """Select the variant for ``device`` (auto, cpu, cuda) and return its name.

    Raises BackendUnavailableError when no renderer works here.
    """
    variant = choose_variant(device)
    if variant == LLVM_VARIANT:
        ensure_llvm()
    if mi.variant() != variant:
        mi.set_variant(variant)
    _look_for_plugins_at_home_only()
    return variant


def traces_here() -> bool:
    """Whether the processor traces rays, and not a graphics card, which processes would share."""
    return bool(mi.variant() == LLVM_VARIANT)


def load_dict(description: dict[str, Any]) -> Any:
    """Mitsuba's object of ``description``, loading nothing from the current folder.

    A plugin that is written in Python has no file beside Mitsuba's own, and is looked for in the
    current folder's ``plugins`` before Mitsuba remembers that it is registered: whatever library
    lies there would be run.
    """
    with contextlib.chdir(_home()):
        return mi.load_dict(description)


def _look_for_plugins_at_home_only() -> None:
    """Take the current folder, which comes first, from where Mitsuba looks for the libraries of its
    plugins.
    """
    resolver = mi.file_resolver()
    resolver.clear()
    resolver.append(str(_home()))


def _home() -> Path:
    """Mitsuba's own folder."""
    return Path(mi.__file__).resolve().parent
