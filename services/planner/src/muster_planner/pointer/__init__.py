"""The embedded model: it reads an instruction beside the site, then writes a plan by pointing at what it read."""
