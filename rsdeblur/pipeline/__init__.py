"""From a photo and its motion to the sharp picture: :func:`rsdeblur.deblur` and :func:`rsdeblur.plan`."""
