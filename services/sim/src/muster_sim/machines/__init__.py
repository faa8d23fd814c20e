"""The machines of a site."""
