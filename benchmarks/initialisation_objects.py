"""Photographs, masks and right cameras of the objects of ``config/benchmark.yaml``.

python benchmarks/initialisation_objects.py --data ../shared/data

Each object gets a folder of images and masks of 256 x 256 pixels, stretched as the report did, of
about 24 views of one round in the order in which the turntable turned, and ``cameras.json``, which
are the right cameras of these images. Of what is made up or scanned there is ``truth.ply`` as well.
What is there already is left.

six made-up, a bowl       rendered from 10 degrees above
blue_cup, shampoo         scans, rendered from 10 degrees above
moisturiser               ALOI: every third photograph, cameras by ``calibrate`` from all 72
shapenet_plane            the renders from 30 degrees above, cameras as given
bunny                     the lower round, cameras as given
head                      every third photograph, cameras as given
axe                       before it was turned over, cameras as given
"""

import argparse
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from rendered import Case, make_truth, take, two_rings

import silmesh
from silmesh.cameras.turntable import orbit_cameras
from silmesh.files import making
from silmesh.geometry.camera import write_cameras
from silmesh.synthetic.layout import OBJECTS

SIZE, VIEWS = 256, 24
ELEVATION = 10.0  # degrees, about ALOI's
PLANE_ELEVATION = 30  # one of the five of the renders
HOLLOW = "bowl"  # of those that rendered.py makes
SCANS = ("blue_cup", "shampoo")
WHITE = 255


@dataclass(frozen=True)
class Taken:
    """Photographs of an object by others, which views of them are taken, and their cameras.

    Attributes:
        images, masks, cameras: within the folder of the data; cameras may be the name of a method
        keep: of the number of a photograph in its folder, whether it is taken
    """

    images: str
    masks: str
    cameras: str
    keep: Callable[[int], bool]


TAKEN = {
    "moisturiser": Taken(
        "aloi_moisturiser/png2/moisturiser",
        "aloi_moisturiser/mask2/moisturiser",
        "calibrate",
        lambda i: i % 3 == 0,
    ),
    "bunny": Taken("bunny/images", "bunny/masks", "bunny/projections", lambda i: i >= 12),
    "head": Taken("head/images", "head/masks", "head/poses_bounds.npy", lambda i: i % 3 == 0),
    "axe": Taken("axe/images", "axe/masks", "axe/cameras.xml", lambda i: i < 26),
}


def main() -> None:
    """Make what is not there."""
    args = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    args.add_argument("--data", type=Path, required=True, help="folder of scans and photographs")
    args.add_argument("--output", type=Path, default=Path("resources/benchmark"))
    given = args.parse_args()
    for name in [*OBJECTS, HOLLOW, *SCANS]:
        _make(given.output / name, lambda to, name=name: _render(name, given.data / "scans", to))
    _make(given.output / "shapenet_plane", lambda to: _unpack(given.data / "shapenet_plane", to))
    for name, taken in TAKEN.items():
        _make(given.output / name, lambda to, taken=taken: _gather(taken, given.data, to))


def _make(folder: Path, make: Callable[[Path], None]) -> None:
    if not folder.exists():
        print(folder, flush=True)
        with making(folder) as part:
            make(part)


def _render(name: str, scans: Path, folder: Path) -> None:
    """Photographs of a made-up or a scanned object."""
    truth = make_truth(name, scans)
    case = Case(name, "pattern" if name == HOLLOW else "own", (ELEVATION,))
    take(case, truth, two_rings(case.rings, SIZE, VIEWS), folder)
    truth.export(folder / "truth.ply")


def _unpack(data: Path, folder: Path) -> None:
    """One round of the renders that SoftRas's example has."""
    renders = np.load(data / "source.npy")  # [views, 4, 64, 64], colours and alpha
    orbits = np.load(data / "camera.npy")  # [views, 3] of distance, elevation, azimuth
    rows = np.flatnonzero(orbits[:, 1] == PLANE_ELEVATION)
    names = [f"v{i:02}" for i in range(len(rows))]
    pictures = np.moveaxis(renders[rows], 1, -1)
    _save(folder / "photos", names, (Image.fromarray(picture[..., :3]) for picture in pictures))
    masks = ((picture[..., 3] >= 128) * np.uint8(WHITE) for picture in pictures)
    _save(folder / "masks", names, map(Image.fromarray, masks))
    orbit = torch.from_numpy(orbits[rows].astype(float)).T
    write_cameras(folder / "cameras.json", orbit_cameras(names, renders.shape[-1], *orbit))


def _gather(taken: Taken, data: Path, folder: Path) -> None:
    """Some photographs of a set, with masks and cameras, all as working images."""
    shown = silmesh.read_photographs(data / taken.images, size=SIZE, resize="stretch")
    found = silmesh.find_silhouettes(shown, data / taken.masks)
    own = data / taken.cameras
    scene = silmesh.find_cameras(shown, found, own if own.exists() else taken.cameras)
    numbers = {view.view: i for i, view in enumerate(shown.views)}
    rows = [i for i, view in enumerate(scene.cameras.views) if taken.keep(numbers[view])]
    names = [f"v{i:02}" for i in range(len(rows))]
    _save(folder / "photos", names, (scene.images[scene.cameras.views[i]] for i in rows))
    masks = (scene.silhouettes[i] * np.uint8(WHITE) for i in rows)
    _save(folder / "masks", names, map(Image.fromarray, masks))
    write_cameras(folder / "cameras.json", scene.cameras.select(rows).named(names))


def _save(folder: Path, names: list[str], pictures: Iterable[Image.Image]) -> None:
    folder.mkdir()
    for name, picture in zip(names, pictures, strict=True):
        picture.save(folder / f"{name}.png")


if __name__ == "__main__":
    main()
