"""The textures of the page: JPEG, as large as a run's share of the page has room for.

The page's meshes have colours of their vertices beside texture coordinates, so that one whose
texture has no room is shown in these.
"""

import base64
from io import BytesIO

from PIL import Image

from silmesh.geometry.glb import Picture, show_picture
from silmesh.report.packing import pack, unpack

ROOM = 1_000_000  # bytes of the page, for the textures of all runs
SIDES = (1024, 768, 512, 384, 256)  # pixels, of which the first that fits is taken
QUALITY = 80
LETTERS = 4 / 3  # of base64, a byte


def encode_texture(image: Image.Image) -> str:
    """A texture as JPEG in base64, at most as large as the page shows any."""
    return base64.b64encode(_encode(image, SIDES[0])).decode()


def add_texture(packed: str, texture: str, room: float) -> str:
    """A packed mesh with its texture, if that has room.

    Args:
        packed: GLB with texture coordinates, as ``pack`` gives it
        texture: of ``encode_texture``
        room: bytes of the page
    """
    content = base64.b64decode(texture)
    with Image.open(BytesIO(content)) as image:
        image.load()
    sizes = [side for side in SIDES if side < image.width]
    for jpeg in (content, *(_encode(image, side) for side in sizes)):
        if LETTERS * len(jpeg) <= room:
            return pack(show_picture(unpack(packed), Picture(jpeg, "image/jpeg")))
    return packed


def _encode(image: Image.Image, side: int) -> bytes:
    stream = BytesIO()
    if image.width > side:
        image = image.resize((side, side), Image.Resampling.LANCZOS)
    image.save(stream, "JPEG", quality=QUALITY, optimize=True)
    return stream.getvalue()
