"""The colours of the photographs on the fitted mesh."""
