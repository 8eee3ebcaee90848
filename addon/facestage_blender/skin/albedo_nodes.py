"""What lies between a skin's albedo and the group that shows it: nodes that come and go in any
order, each of which passes on what came before it.
"""

from __future__ import annotations

from typing import Any

import bpy

from facestage.contract.texture_maps import ALBEDO

from .material import GROUP


def put_before_skin(
    tree: bpy.types.NodeTree, into: bpy.types.NodeSocket, out: bpy.types.NodeSocket
) -> None:
    """Lead what the skin's albedo is so far ``into`` a node, and what comes ``out`` of it to the
    skin.
    """
    albedo = tree.nodes[GROUP].inputs[ALBEDO.socket]
    _pass_on(tree, albedo, into)
    tree.links.new(out, albedo)


def take_out(
    tree: bpy.types.NodeTree, into: bpy.types.NodeSocket, out: bpy.types.NodeSocket
) -> None:
    """Lead what comes ``into`` a node to all that it went to; the node may be removed then."""
    for link in list(out.links):
        after = link.to_socket
        _pass_on(tree, into, after)
        if not into.is_linked:
            tree.links.remove(next(each for each in after.links if each.from_socket == out))


def _pass_on(tree: bpy.types.NodeTree, socket: Any, to: Any) -> None:
    """Give ``to`` the link or the color of ``socket``."""
    color = tuple(socket.default_value)[:3]
    to.default_value = (*color, 1.0)[: len(to.default_value)]
    if socket.is_linked:
        tree.links.new(socket.links[0].from_socket, to)
