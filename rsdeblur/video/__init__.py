"""Videos: blurred frames deblurred, each with its own exposure window (extra ``[video]``).

`clip` reads the frames of a video and finds when each was exposed, `plan` looks at the blur of all frames, and `encode`
deblurs and encodes them in one pass.
"""

from rsdeblur.choices import Quality

# The default for videos: the published method's filter takes about a fifth of the time of the photos' default.
QUALITY: Quality = "fast"
