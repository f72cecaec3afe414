"""What colours a thing has: a mixture of Gaussians of the pixels that are known to show it.

The components are the clusters of k-means, as in GrabCut (Rother et al. 2004), and a little of all
colours, so that no pixel is impossible.
"""

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.special import logsumexp

COMPONENTS = 5
SAMPLED = 3000  # most pixels of which a model is made
SPREAD = 3.0  # grey levels: least standard deviation of a component
ANY = 0.05  # share of the pixels that may have any colour


class ColourModel:
    """The density of colours.

    Args:
        pixels: [n, 3] uint8, at least one
        seed: of the choice of pixels, where they are many, and of the clusters
    """

    def __init__(self, pixels: np.ndarray, seed: int = 0):
        rng = np.random.default_rng(seed)
        chosen = rng.choice(len(pixels), min(len(pixels), SAMPLED), replace=False)
        colours = pixels[chosen].astype(np.float64)
        noise = rng.normal(0, 0.5, colours.shape)  # equal colours would make empty clusters
        count = min(COMPONENTS, len(colours))
        _, labels = kmeans2(colours + noise, count, minit="++", rng=rng, missing="warn")
        parts = [colours[labels == i] for i in range(count) if (labels == i).any()]
        self._weights = np.array([len(part) for part in parts]) / len(colours)
        self._means = np.array([part.mean(axis=0) for part in parts])
        least = SPREAD**2 * np.eye(3)
        self._covariances = np.array([np.cov(p.T, bias=True) + least for p in parts])

    def log_density(self, pixels: np.ndarray) -> np.ndarray:
        """The logarithm of the density of colours [n, 3]: [n]."""
        apart = pixels.astype(np.float64)[:, None] - self._means  # [n, components, 3]
        inverse = np.linalg.inv(self._covariances)
        square = np.einsum("nci,cij,ncj->nc", apart, inverse, apart)
        scale = np.linalg.slogdet(2 * np.pi * self._covariances)[1]
        found = logsumexp(np.log(self._weights) - (square + scale) / 2, axis=1)
        return np.logaddexp(np.log(1 - ANY) + found, np.log(ANY) - 3 * np.log(256))
