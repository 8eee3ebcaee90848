"""What all pieces of a film share: where the face is, the person of the keyframes, one light."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.errors import InputError
from facestage.contract.files.partial import KEYFRAMES, PIECES
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.person import Person
from facestage.contract.result import Result
from facestage.fit.face.state import State
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.keyframes import Prepared
from facestage.fit.sequence.request import Request
from facestage.fit.sequence.sightings import Sightings
from facestage.models.registry import load_model

SHARED = "shared.npz"


@dataclass(frozen=True, eq=False)
class Shared:
    """A film that is ``prepared``, its ``actor`` under the light of all keyframes, and where these
    have the face.
    """

    prepared: Prepared
    actor: Actor
    states: list[State]

    @classmethod
    def load(cls, request: Request, partial: Path) -> Shared:
        """What :func:`save_shared` has left in the ``partial`` folder. Wants the renderer started.
        Raises InputError.
        """
        found = read_arrays(partial / PIECES / SHARED, "checkpoint")
        try:
            keyframes, lights = found["keyframes"].tolist(), found["lights"]
        except KeyError as error:
            raise InputError(
                f"The checkpoint '{partial / PIECES / SHARED}' is damaged ({error}); start again "
                "without --resume."
            ) from error
        model = load_model(request.model)
        sightings = Sightings.load(partial, request.fingerprint)
        person = Person.load(partial / KEYFRAMES)
        results = [Result.load(partial / KEYFRAMES / photo.folder) for photo in person.photos]
        landmarks = sightings.landmarks(model)
        prepared = Prepared(model, sightings, landmarks, keyframes, [], person, results, None)
        actor, states = prepared.person_found()
        return cls(prepared, actor.lit(lights), states)


def save_shared(partial: Path, prepared: Prepared, lights: Float[np.ndarray, " lights"]) -> None:
    """Leave for the pieces, beside what the film's run leaves anyway, which frames are keyframes
    and the light (parameters).
    """
    (partial / PIECES).mkdir(exist_ok=True)
    arrays = {"keyframes": np.array(prepared.keyframes), "lights": lights}
    write_arrays(partial / PIECES / SHARED, arrays)
