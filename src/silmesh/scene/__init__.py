"""The scene: views, silhouettes and cameras in one world, judged by each other; outliers found."""
