"""From gyro log to blur paths: where the light of each pixel comes from while its row is exposed."""
