"""Pictures: pixel encoding, tone curves, clipped highlights."""
