"""Language models behind a server's API."""
