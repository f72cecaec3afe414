r"""What required libraries do that is done here, too: whether it is the same, and times, as JSON.

python benchmarks/libraries.py results/*/*/mesh.ply

Self-intersections by igl (also of the given meshes), lenses by pycolmap, distance transforms by
OpenCV. Times are medians of processor time on one thread, in milliseconds, ours first.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import igl.predicates
import numpy as np
import PIL.Image  # noqa: F401 pycolmap comes after it
import pycolmap
import trimesh
from scipy.ndimage import distance_transform_edt

from silmesh.evaluation.mesh_quality import count_intersections
from silmesh.geometry.lens import PARAMETERS, Lens

REPEATS = 7
LENSES = {
    "SIMPLE_RADIAL": (-0.1,),
    "OPENCV": (-0.2, 0.05, 1e-3, -2e-3),
    "FULL_OPENCV": (-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.02, 0.0, 0.0),
    "OPENCV_FISHEYE": (0.02, -0.01, 1e-3, 0.0),
    "THIN_PRISM_FISHEYE": (0.02, -0.01, 1e-3, -2e-3, 0.0, 0.0, 1e-3, 1e-3),
    "FOV": (0.9,),
}
POINTS, WIDE = 200_000, 2.5  # normalised coordinates up to these, of which some lenses fold some
LIBRARIES = ("igl.predicates", "pycolmap", "cv2", "scipy.ndimage")


def measure(*acts: Callable[[], Any]) -> list[float]:
    """The median time of each act, once it has been done once."""
    medians = []
    for act in acts:
        act()
        passed = []
        for _ in range(REPEATS):
            start = time.process_time()
            act()
            passed.append(time.process_time() - start)
        medians.append(round(1e3 * float(np.median(passed)), 3))
    return medians


def make_meshes() -> dict[str, trimesh.Trimesh]:
    """Meshes that cut themselves, and one that only touches itself."""
    ball, box = trimesh.creation.icosphere(4), trimesh.creation.box()
    noise = 0.06 * np.random.default_rng(0).normal(size=ball.vertices.shape)
    other = ball.copy().apply_translation([0.7, 0.1, 0.2])
    return {
        "sphere": ball,
        "rough sphere": trimesh.Trimesh(ball.vertices + noise, ball.faces, process=False),
        "two spheres": trimesh.util.concatenate([ball, other]),
        "two cubes side by side": trimesh.util.concatenate(
            [box, box.copy().apply_translation([0, 0, 1])]
        ),
    }


def compare_intersections(meshes: dict[str, trimesh.Trimesh]) -> Iterator[dict[str, Any]]:
    """Pairs of triangles that cut each other by ours, and that meet by igl."""
    for name, mesh in meshes.items():
        verts = np.ascontiguousarray(mesh.vertices, np.float64)
        faces = np.ascontiguousarray(mesh.faces, np.int64)
        given = verts, faces
        yield {
            "what": f"self-intersections, {name}, {len(faces)} faces",
            "ours": count_intersections(*given),
            "igl": len(igl.predicates.find_self_intersections(*given)[1]),
            "ms": measure(
                lambda given=given: count_intersections(*given),
                lambda given=given: igl.predicates.find_self_intersections(*given),
            ),
        }


def compare_lenses() -> Iterator[dict[str, Any]]:
    """How much both differ, the points that a lens folds, and how far both find back."""
    known = set(pycolmap.CameraModelId.__members__)
    yield {"what": "lens models that pycolmap lacks", "models": sorted(set(PARAMETERS) - known)}
    points = np.random.default_rng(0).uniform(-WIDE, WIDE, (POINTS, 2))
    for model, parameters in LENSES.items():
        lens = Lens(model, parameters)
        camera = pycolmap.Camera.create_from_model_name(0, model, 1.0, 2, 2)
        camera.params = [*[1.0] * len(camera.focal_length_idxs()), 0.0, 0.0, *parameters]
        space = np.hstack([points, np.ones((POINTS, 1))])
        ours, theirs = lens.distort(points), camera.img_from_cam(space)
        shown = np.isfinite(ours).all(axis=1)
        goal = ours[shown]
        yield {
            "what": f"lens {model}",
            "differ": float(np.abs(ours - theirs)[shown].max()),
            "folded": int((~shown).sum()),
            "folded_but_shown_by_pycolmap": int(np.isfinite(theirs).all(axis=1)[~shown].sum()),
            "distort_ms": measure(
                lambda lens=lens: lens.distort(points),
                lambda camera=camera, space=space: camera.img_from_cam(space),
            ),
            "undistort_ms": measure(
                lambda lens=lens, goal=goal: lens.undistort(goal),
                lambda camera=camera, goal=goal: camera.cam_from_img(goal),
            ),
        }


def find_distances(inside: np.ndarray) -> np.ndarray:
    """The exact distances to the outside by OpenCV: [height, width] float32."""
    return cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


def compare_distances() -> Iterator[dict[str, Any]]:
    """The largest difference of the distances within a wavy ellipse, in pixels."""
    for size in (128, 256, 1024):
        rows, columns = np.mgrid[:size, :size] / size - 0.5
        inside = (rows / 0.3) ** 2 + (columns / 0.4) ** 2 < 1 + 0.2 * np.sin(40 * rows)
        ours, theirs = distance_transform_edt(inside), find_distances(inside)
        yield {
            "what": f"distance transform, {size} x {size}",
            "differ": float(np.abs(ours - theirs).max()),
            "equal_as_float32": bool((ours.astype(np.float32) == theirs).all()),
            "ms": measure(
                lambda inside=inside: distance_transform_edt(inside),
                lambda inside=inside: find_distances(inside),
            ),
        }


def time_import(name: str) -> dict[str, Any]:
    """What it costs a step to import a library, where numpy and Pillow are there."""
    code = f"import time; t = time.process_time(); import {name}; print(time.process_time() - t)"
    words = [sys.executable, "-c", f"import numpy, PIL.Image; {code}"]
    passed = [float(subprocess.check_output(words)) for _ in range(REPEATS)]
    return {"what": f"import {name}", "ms": round(1e3 * float(np.median(passed)), 1)}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("meshes", type=Path, nargs="*")
    files = parser.parse_args().meshes
    cv2.setNumThreads(1)
    meshes = make_meshes() | {str(file): trimesh.load_mesh(file, process=False) for file in files}
    for part in (compare_intersections(meshes), compare_lenses(), compare_distances()):
        for found in part:
            print(json.dumps(found), flush=True)
    for name in LIBRARIES:
        print(json.dumps(time_import(name)), flush=True)


if __name__ == "__main__":
    main()
