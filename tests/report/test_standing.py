"""The page's mesh in the colours of what it stands on."""

import json
import struct

import numpy as np
import trimesh

from silmesh.report.exhibit import show_standing
from silmesh.report.measures import describe_relief
from silmesh.report.packing import unpack


def colours_of(glb: bytes) -> np.ndarray:
    """COLOR_0 of a packed mesh, in steps of 1/65535: [verts, 4]."""
    length = struct.unpack("<I", glb[12:16])[0]
    tree = json.loads(glb[20 : 20 + length])
    view = tree["bufferViews"][tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
    start = 28 + length + view["byteOffset"]
    return np.frombuffer(glb[start : start + view["byteLength"]], np.uint16).reshape(-1, 4)


def test_each_standing_has_its_colour():
    ball = trimesh.creation.icosphere(1)
    standing = np.arange(len(ball.vertices)) % 3
    packed = show_standing(ball.vertices, ball.faces, standing)
    colours = colours_of(unpack(packed))
    for what in range(3):
        assert len(np.unique(colours[standing == what], axis=0)) == 1
    assert len(np.unique(colours, axis=0)) == 3


def test_one_standing_is_not_shown():
    ball = trimesh.creation.icosphere(1)
    assert show_standing(ball.vertices, ball.faces, None) is None
    assert show_standing(ball.vertices, ball.faces, np.zeros(len(ball.vertices), int)) is None


def test_the_page_says_what_was_decided():
    told = {"surface": {"outline": 0.25, "photographs": 0.75, "guess": 0.0}}
    told["relief"] = {"said": "the photographs move 75% of the surface: so"}
    said = describe_relief(told)
    assert said.startswith("the photographs move 75%")
    assert "25% outline, 75% photographs, 0% guess" in said
    assert describe_relief({}) == ""
