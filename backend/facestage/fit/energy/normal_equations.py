"""J^T W J and J^T W r of the photometric term, with the structure of its Jacobian used.

Light of one color lights that color only, so the (3 P, 3 N) light columns are three (P, N) matrices
and their products a third to a ninth of the work; lights of one common color never need more than N
columns per channel. The specular map's columns share one sparse matrix of bilinear weights between
the channels.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Float
from facestage.fit.energy.photo_jacobian import Jacobian, JacobianBlock
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import CHANNELS


class NormalEquations:
    """Sums over blocks of pixels: products in float32, their sum over blocks in float64."""

    def __init__(self, jacobian: Jacobian, layout: Layout) -> None:
        self.jacobian, self.layout = jacobian, layout
        dense, lights = len(jacobian.dense_columns), len(jacobian.light_index)
        texels = (
            layout.slices["specular"].stop - layout.slices["specular"].start
            if jacobian.active["specular"]
            else 0
        )
        self._dense, self._dense_right = np.zeros((dense, dense)), np.zeros(dense)
        self._lights, self._lights_right = (
            np.zeros((CHANNELS, lights, lights)),
            np.zeros((CHANNELS, lights)),
        )
        self._cross = np.zeros((CHANNELS, dense, lights))
        self._texels, self._texels_right = sp.csr_matrix((texels, texels)), np.zeros(texels)
        self._texels_dense, self._texels_lights = (
            np.zeros((texels, dense)),
            np.zeros((CHANNELS, texels, lights)),
        )

    def add(
        self,
        block: JacobianBlock,
        residual: Float[np.ndarray, "pixels 3"],
        weights: Float[np.ndarray, " pixels"],
    ) -> None:
        """Add a block's pixels with ``residual`` and ``weights``, shared by the
        channels.
        """
        root = np.sqrt(weights).astype(np.float32)
        # In place of another copy as large as the Jacobian: blocks belong to whoever asked for
        # them.
        dense, lights = block.dense, block.lights * root[:, None]
        dense *= root[:, None]
        # A float64 factor would make numpy copy the other one to float64.
        right = residual.T.astype(np.float32) * root
        flat = dense.reshape(CHANNELS * len(weights), dense.shape[2])
        self._dense += flat.T @ flat
        self._dense_right += right.ravel() @ flat
        for channel in range(CHANNELS):
            self._lights[channel] += lights[channel].T @ lights[channel]
            self._lights_right[channel] += right[channel] @ lights[channel]
            self._cross[channel] += dense[channel].T @ lights[channel]
        if block.texels is not None:
            self._add_texels(
                block.texels, block.gloss.T.astype(np.float32) * root, dense, lights, right
            )

    def _add_texels(
        self,
        texels: sp.csr_matrix,
        gloss: Float[np.ndarray, "3 pixels"],
        dense: Float[np.ndarray, "3 pixels columns"],
        lights: Float[np.ndarray, "3 pixels lights"],
        right: Float[np.ndarray, "3 pixels"],
    ) -> None:
        """``gloss`` and all that follow have the root of the weights in them."""
        pick = texels.T.tocsr()
        self._texels = self._texels + pick @ sp.diags((gloss**2).sum(axis=0)) @ texels
        self._texels_right += pick @ (gloss * right).sum(axis=0)
        self._texels_dense += pick @ np.einsum("cb,cbk->bk", gloss, dense)
        for channel in range(CHANNELS):
            self._texels_lights[channel] += pick @ (gloss[channel, :, None] * lights[channel])

    def assembled(
        self,
    ) -> tuple[Float[np.ndarray, "unknowns unknowns"], Float[np.ndarray, " unknowns"]]:
        """Hessian and gradient over all parameters; zero for those without a
        column.
        """
        layout, jacobian = self.layout, self.jacobian
        hessian, gradient = np.zeros((layout.size, layout.size)), np.zeros(layout.size)
        columns, light = jacobian.dense_columns, layout.slices["lights"]
        texture = layout.slices["specular"]
        hessian[np.ix_(columns, columns)] = self._dense
        gradient[columns] = self._dense_right
        if len(jacobian.light_index):
            by_parameter = jacobian.light_jacobian.transpose(1, 0, 2)  # (3, n, light parameters)
            hessian[light, light] = (
                by_parameter.transpose(0, 2, 1) @ self._lights @ by_parameter
            ).sum(axis=0)
            gradient[light] = np.einsum("cn,cnp->p", self._lights_right, by_parameter)
            cross = (self._cross @ by_parameter).sum(axis=0)
            hessian[columns, light] = cross
            hessian[light, columns] = cross.T
        if jacobian.active["specular"]:
            hessian[texture, texture], gradient[texture] = (
                self._texels.toarray(),
                self._texels_right,
            )
            hessian[texture, columns], hessian[columns, texture] = (
                self._texels_dense,
                self._texels_dense.T,
            )
            if len(jacobian.light_index):
                cross = (self._texels_lights @ by_parameter).sum(axis=0)
                hessian[texture, light], hessian[light, texture] = cross, cross.T
        return hessian, gradient
