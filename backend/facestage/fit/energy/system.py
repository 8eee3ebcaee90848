"""The normal equations of all terms around one state."""

from __future__ import annotations

import numpy as np

from facestage.fit.energy.photo_term import Evaluation, common_energy
from facestage.fit.energy.terms import Energy
from facestage.fit.face.state import State


class System:
    """The quadratic model around one state, with its weights frozen."""

    def __init__(
        self, energy: Energy, state: State, evaluation: Evaluation | None, active: np.ndarray
    ) -> None:
        self.energy, self.state, self.evaluation = energy, state, evaluation
        prior = energy.priors.quadratic(state)
        self.prior_hessian = prior.hessian
        self.hessian, self.gradient = prior.hessian.copy(), prior.gradient
        self.terms = dict(prior.energy)
        self._prior_total = sum(prior.energy.values())
        self._landmarks = energy.landmarks.at(state)
        residual = self._landmarks.residuals(state)
        self._landmark_weights = energy.weights.landmarks * self._landmarks.robust_weights(residual)
        jacobian = self._landmarks.jacobian(state, energy.layout)
        # Most columns are those of light and skin, which move no landmark.
        moving = np.flatnonzero(jacobian.any(axis=0))
        jacobian = jacobian[:, moving]
        self.hessian[np.ix_(moving, moving)] += jacobian.T @ (
            jacobian * self._landmark_weights[:, None]
        )
        self.gradient[moving] += jacobian.T @ (self._landmark_weights * residual)
        self._landmark_energy = 0.5 * float(self._landmark_weights @ residual**2)
        self.terms["landmarks"] = self._landmark_energy
        self._silhouette = energy.silhouette.find(state) if energy.silhouette is not None else None
        if self._silhouette is not None:
            residual = self._silhouette.residuals(state)
            self._silhouette_weights = energy.weights.photo * self._silhouette.weights(residual)
            jacobian = self._silhouette.jacobian(state, energy.layout)
            self.hessian += jacobian.T @ (jacobian * self._silhouette_weights[:, None])
            self.gradient += jacobian.T @ (self._silhouette_weights * residual)
            self.terms["silhouette"] = 0.5 * float(self._silhouette_weights @ residual**2)
        if evaluation is not None:
            assert energy.photo is not None
            self.noise = energy.photo.noise(evaluation)
            self._weights = energy.photo.weights(evaluation, self.noise, energy.weights.photo)
            hessian, gradient = energy.photo.normal_equations(
                evaluation, self._weights, energy.layout, active
            )
            self.hessian += hessian
            self.gradient += gradient
            self.terms["photo"] = common_energy(evaluation, evaluation, self._weights)[0]
        self.total = sum(self.terms.values())

    def decrease(self, state: State, evaluation: Evaluation | None) -> float:
        """How much lower the energy is at ``state``, the weights unchanged."""
        prior = sum(self.energy.priors.energies(state).values())
        residual = self._landmarks.residuals(state)
        if not np.isfinite(residual).all():
            return -np.inf
        result = self._prior_total - prior
        result += self._landmark_energy - 0.5 * float(self._landmark_weights @ residual**2)
        if self._silhouette is not None:
            result += self.terms["silhouette"]
            result -= 0.5 * float(self._silhouette_weights @ self._silhouette.residuals(state) ** 2)
        if evaluation is not None and self.evaluation is not None:
            old, new = common_energy(self.evaluation, evaluation, self._weights)
            result += old - new
        return float(result) if np.isfinite(result) else -np.inf
