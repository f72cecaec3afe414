"""Thresholds of the coherence: the hull IoU of a view, averaged over the views.

The hull IoU of a view is the IoU of its silhouette with the rendered visual hull of all views.
"""

CONVINCING = 0.95  # cameras with at least this coherence are taken without trying other sources
# Other cameras are not sought where those of all views have at least this coherence: others would
# be taken if they had 0.02 more, which masks of real photographs seldom allow.
UNBEATEN = 0.97
COHERENT = 0.9  # below this, cameras and silhouettes are said to contradict each other
REFUSED = 0.6  # below this, cameras that were estimated from photographs are refused
