"""Pictures: pixel encoding, tone curves, clipped highlights, light below black."""
