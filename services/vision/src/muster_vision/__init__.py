"""UAV frames to a map of named objects.

Frames become one metric bird's-eye view (`camera`, `birdseye`); selective search proposes regions in it (`regions`);
an open_clip model says what they are (`clip_model`, `detector`, `outline`); tracking keeps their names
(`tracker`, `store`); the map goes onto the bus (`object_map`, `service`).
"""
