"""From gyro log to blur paths: where each pixel's light comes from while its row is exposed."""
