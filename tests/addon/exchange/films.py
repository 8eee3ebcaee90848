"""A film of grey pictures: how many, how large, how fast."""

RATE, FRAMES = 29.97, 12
WIDTH, HEIGHT = 64, 48
