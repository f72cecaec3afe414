"""Coherence, as a mean hull IoU: from where on cameras and silhouettes are believed.

The hull IoU of a view is the IoU of the visual hull, rendered in it, with its silhouette.
"""

CONVINCING = 0.95  # cameras that reach it are taken, and no other source of cameras is tried
COHERENT = 0.9  # below it, cameras and silhouettes contradict each other
REFUSED = 0.6  # below it, cameras that were found from the photographs are refused
