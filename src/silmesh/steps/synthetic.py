"""Make an object, photograph it on the turntable, and save photographs, masks and the truth."""

import argparse
from contextlib import ExitStack
from pathlib import Path

import torch
from PIL import Image

from silmesh.files import replacing
from silmesh.synthetic.layout import OBJECTS, SIZE, VIEWS, photograph_names
from silmesh.synthetic.make import find_paint, make_object
from silmesh.synthetic.photograph import photograph, turntable_cameras


def main(argv: list[str] | None = None) -> None:
    """Run the step."""
    args = _parse(argv)
    names = photograph_names(args.object, args.views)
    cameras = turntable_cameras(
        [Path(name).stem for name in names],
        torch.tensor([SIZE] * args.views),
        step=360 / args.views,
    )
    mesh = make_object(args.object)
    with ExitStack() as stack:
        images, masks, truth = (
            stack.enter_context(replacing(path)) for path in (args.images, args.masks, args.truth)
        )
        images.mkdir()
        masks.mkdir()
        pictures = photograph(mesh, cameras, find_paint(args.object))
        for name, (image, mask) in zip(names, pictures, strict=True):
            # Noise hardly compresses: more effort would take longer and save little.
            Image.fromarray(image).save(images / name, compress_level=1)
            Image.fromarray(mask).save(masks / name)
        mesh.export(truth)


def _parse(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="silmesh.steps.synthetic", description=__doc__)
    parser.add_argument("object", choices=OBJECTS)
    parser.add_argument("--images", type=Path, required=True, help="folder of the photographs")
    parser.add_argument("--masks", type=Path, required=True, help="folder of the masks")
    parser.add_argument("--truth", type=Path, required=True, help="the mesh, a .ply file")
    parser.add_argument("--views", type=int, default=VIEWS, help="evenly around the object")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
