"""Which silhouettes can be trusted, and what is done with those that cannot."""
