"""Retraining of DeepLabv3: cutouts of photographed objects, composited over random backgrounds."""
