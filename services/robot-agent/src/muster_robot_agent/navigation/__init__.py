"""Getting from here to there: cost map, path search, path following, and making way for other robots."""
