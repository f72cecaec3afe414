"""A texture against colours of the vertices, on photographs that neither is made from: JSON.

python benchmarks/texture.py results/head/auto ...

Takes results of the workflow; ``fit: {holdout: 6}`` keeps the same photographs out of the fit. For
each: PSNR and SSIM inside the object, the photographs at their own size but at most 1,000 pixels
long, of every sixth photograph, and of every sixth of the others for comparison. ``--limits``
says what a held-out photograph differs by: its exposure (a gain a channel), light and shade (means
over 12 pixels), and where the mesh is astray (optical flow).
"""

import argparse
import json
import resource
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from scipy.ndimage import gaussian_filter
from skimage.registration import optical_flow_tvl1
from skimage.transform import warp

from silmesh.evaluation.appearance import LONGEST, compare
from silmesh.geometry.camera import Cameras, read_cameras
from silmesh.geometry.mesh_files import read_mesh
from silmesh.geometry.originals import Originals
from silmesh.reading import read_json
from silmesh.scene.scene import SILHOUETTES, VIEWS
from silmesh.silhouettes import read_silhouettes
from silmesh.texture.bake import Texture, bake
from silmesh.texture.rendering import render, render_vertex_colours
from silmesh.texture.vertex_colours import colour_vertices
from silmesh.views import ImageFolder, held_out, read_views, stack_pictures

EVERY = 6
BROAD = 12  # pixels over which light and shade change


@dataclass(frozen=True)
class Made:
    """What the workflow made of an object."""

    mesh: trimesh.Trimesh
    cameras: Cameras
    originals: Originals
    pictures: np.ndarray
    silhouettes: np.ndarray


def main() -> None:
    """Print what was measured."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("results", type=Path, nargs="+", help="results/OBJECT/VARIANT")
    args.add_argument("--pictures", type=Path, help="folder for what is compared, beside it")
    args.add_argument("--limits", action="store_true", help="what the rest is due to")
    args.add_argument("--unrefined", action="store_true", help="cameras as they are")
    given = args.parse_args()
    for folder in given.results:
        print(json.dumps({str(folder): measure(load(folder), folder.parent.name, given)}, indent=1))


def load(folder: Path) -> Made:
    """What the workflow left of an object and a variant."""
    scene = (folder.parents[1] / read_json(folder / "metrics.json")["silhouettes"]).parent
    views = next(
        path
        for path in (folder.parent / "stages/views").iterdir()
        if scene.name.startswith(path.name)
    )
    cameras = read_cameras(folder / "cameras.json")
    return Made(
        read_mesh(folder / "mesh.ply"),
        cameras,
        Originals(
            cameras,
            read_views(views),
            read_json(scene / "scene.json").get("lenses"),
            longest=LONGEST,
        ),
        stack_pictures(ImageFolder(scene / VIEWS), cameras.views),
        read_silhouettes(scene / SILHOUETTES, cameras.views),
    )


def measure(made: Made, name: str, given: argparse.Namespace) -> dict:
    """Bake from all but every sixth photograph, and compare."""
    held = held_out(len(made.originals), EVERY)
    kept = [i for i in range(len(made.originals)) if i not in held]
    bake(made.mesh, made.originals, made.silhouettes, 256, kept[:3])  # compiles
    start = time.perf_counter(), time.process_time()
    texture = bake(
        made.mesh, made.originals, made.silhouettes, kept=kept, refine=not given.unrefined
    )
    seconds = time.perf_counter() - start[0], time.process_time() - start[1]
    colours = colour_vertices(
        made.mesh.vertices,
        made.mesh.faces,
        made.cameras.select(kept),
        made.pictures[kept],
        made.silhouettes[kept],
    )
    found = {"vertices": len(made.mesh.vertices), "views": len(kept)}
    found |= {"seconds": round(seconds[0], 1), "cpu_seconds": round(seconds[1], 1)}
    found["megabytes"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    for which, views in (("held_out", held), ("used", kept[::EVERY])):
        cameras = made.originals.cameras.select(views)
        plain = render_vertex_colours(made.mesh.vertices, made.mesh.faces, colours, cameras)
        found[which] = {
            "vertex_colours": _score(made, views, plain),
            "texture": _score(made, views, render(texture, cameras)),
        }
    if given.limits:
        found["limits"] = _find_limits(made, held, texture)
    if given.pictures:
        _draw(made, held[len(held) // 2], texture, colours, given.pictures / f"{name}.png")
    return found | {"notes": {k: v for k, v in texture.notes.items() if k != "gains"}}


Pictures = Iterable[tuple[np.ndarray, np.ndarray]]


def _score(made: Made, views: Sequence[int], pictures: Pictures) -> dict[str, float]:
    """PSNR and SSIM within the object, means over the views."""
    scores = [
        compare(image, made.originals.read(i), covered & _outline(made, i))
        for i, (image, covered) in zip(views, pictures, strict=True)
    ]
    psnr, ssim = np.mean(scores, axis=0)
    return {"psnr": round(float(psnr), 2), "ssim": round(float(ssim), 3)}


def _outline(made: Made, i: int) -> np.ndarray:
    return made.originals.enlarge(i, made.silhouettes[i])


def _find_limits(made: Made, views: Sequence[int], texture: Texture) -> dict[str, float]:
    """PSNR once what a texture cannot know is taken from the photographs themselves."""
    found = []
    for i, (image, covered) in zip(
        views, render(texture, made.originals.cameras.select(views)), strict=True
    ):
        inside = covered & _outline(made, i)
        rows, columns = (slice(at.min(), at.max() + 1) for at in np.nonzero(inside))
        near = made.originals.read(i)[rows, columns].astype(float)
        found.append(_explain(image[rows, columns].astype(float), near, inside[rows, columns]))
    return {k: round(float(np.mean([one[k] for one in found])), 2) for k in found[0]}


def _explain(image: np.ndarray, photograph: np.ndarray, inside: np.ndarray) -> dict[str, float]:
    gain = (image * photograph)[inside].sum(axis=0) / (image**2)[inside].sum(axis=0)
    lit = image + _blur(photograph - image, inside)
    moved, shift = _register(image, lit, photograph, inside)
    both = moved + _blur(photograph - moved, inside)
    shown = {"as_it_is": image, "exposure": image * gain, "light": lit}
    shown |= {"flow": moved, "light_and_flow": both}
    errors = {k: ((v - photograph)[inside] ** 2).mean() for k, v in shown.items()}
    return {k: 10 * np.log10(255**2 / v) for k, v in errors.items()} | {"flow_pixels": shift}


def _blur(image: np.ndarray, inside: np.ndarray) -> np.ndarray:
    weight = np.maximum(gaussian_filter(inside.astype(float), BROAD), 1e-3)
    return gaussian_filter(image * inside[..., None], (BROAD, BROAD, 0)) / weight[..., None]


def _register(
    image: np.ndarray, lit: np.ndarray, photograph: np.ndarray, inside: np.ndarray
) -> tuple[np.ndarray, float]:
    """An image moved onto a photograph by optical flow, and the mean pixels it moves by."""
    still, moving = (a.mean(axis=-1) * inside / 255 for a in (photograph, lit))
    flow = optical_flow_tvl1(still, moving, attachment=15, num_warp=5)
    at = np.mgrid[: inside.shape[0], : inside.shape[1]] + flow
    moved = np.stack([warp(image[..., k], at, mode="edge", order=1) for k in range(3)], axis=-1)
    return moved, float(np.hypot(*flow)[inside].mean())


def _draw(made: Made, i: int, texture: Texture, colours: np.ndarray, path: Path) -> None:
    """A photograph, the texture and the colours of the vertices, side by side."""
    camera = made.originals.cameras.select([i])
    ((textured, covered),) = render(texture, camera)
    verts, faces = made.mesh.vertices, made.mesh.faces
    ((plain, _),) = render_vertex_colours(verts, faces, colours, camera)
    rows, columns = (slice(at.min(), at.max() + 1) for at in np.nonzero(covered))
    strip = [a[rows, columns] for a in (made.originals.read(i), textured, plain)]
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(strip, axis=1)).save(path)


if __name__ == "__main__":
    main()
