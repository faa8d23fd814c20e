"""Where the journal's rows lie: one narrow port, and SQLite and PostgreSQL behind it."""
