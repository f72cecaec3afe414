"""Moving and scaling an initial mesh to where the silhouettes are, if it lies elsewhere."""

import torch
from torch import Tensor

from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import WHOLE

OVERLAP = 0.5  # a mesh is moved if the mean IoU of the bounding boxes is below this


def move_to_silhouettes(
    verts: Tensor, cameras: Cameras, silhouettes: Tensor, known: Tensor | None = None
) -> Tensor:
    """Shift and scale a mesh so that its bounding boxes in the views match the silhouettes'.

    The shift is by least squares to the rays through the boxes' middles; the scale is the median
    over the views of the ratio of the boxes' diagonals. A mesh whose boxes overlap the silhouettes'
    by half or more stays. Views whose frame cuts the silhouette have no say, if enough others are
    there.

    Args:
        verts: [verts, 3]
        cameras: of the views
        silhouettes: [views, height, width], 0 or 1, none empty
        known: as many, the pixels of which each view says anything: of all that it shows whole
    Returns:
        [verts, 3]
    """
    if known is not None:
        whole = known.flatten(1).all(dim=1).nonzero().squeeze(1).tolist()
        if len(whole) < WHOLE:
            return verts  # boxes that are cut tell no place
        cameras, silhouettes = cameras.select(whole), silhouettes[whole]
    wished = _boxes_of(silhouettes)
    if _overlap(_boxes(cameras.project(verts)), wished) >= OVERLAP:
        return verts
    middle = (verts.min(0).values + verts.max(0).values) / 2
    target = cameras.meet(wished.mean(dim=1).double())
    moved = verts - middle + target.to(verts)
    ratio = _diagonals(wished) / _diagonals(_boxes(cameras.project(moved)))
    return (moved - target.to(verts)) * ratio.nanmedian() + target.to(verts)


def _boxes(points: Tensor) -> Tensor:
    """Least and greatest of points [views, n, 2]: [views, 2, 2]."""
    return torch.stack([points.min(1).values, points.max(1).values], dim=1)


def _boxes_of(silhouettes: Tensor) -> Tensor:
    """Least and greatest x and y of the silhouettes: [views, 2, 2]."""
    corners = torch.stack([_boxes(s.nonzero().flip(1).unsqueeze(0))[0] for s in silhouettes > 0.5])
    return corners + torch.tensor([[0.0], [1.0]], device=corners.device)


def _diagonals(boxes: Tensor) -> Tensor:
    return (boxes[:, 1] - boxes[:, 0]).norm(dim=1)


def _overlap(a: Tensor, b: Tensor) -> float:
    """Mean IoU of boxes [views, 2, 2]."""
    low, high = torch.maximum(a[:, 0], b[:, 0]), torch.minimum(a[:, 1], b[:, 1])
    both = (high - low).clamp(min=0).prod(dim=1)
    either = (a[:, 1] - a[:, 0]).prod(dim=1) + (b[:, 1] - b[:, 0]).prod(dim=1) - both
    return float((both / either).nan_to_num().mean())
