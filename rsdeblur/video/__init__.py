"""Videos: blurred frames deblurred, each with its own exposure window (extra ``[video]``).

`clip` reads a video's properties and frames, `times` finds when each frame was exposed, `plan` passes over all frames
once, `segments` deblurs and encodes a few frames at a time, and `joining` puts the segments and the sound together.
"""

from rsdeblur.choices import Quality

# The default for videos: the published method's filter takes about a fifth of the time of the photos' default.
QUALITY: Quality = "fast"
