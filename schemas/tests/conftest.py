"""Generated examples: few each, because the table is long, and never judged by their speed."""

from hypothesis import settings

settings.register_profile("schemas", deadline=None, max_examples=15)
settings.load_profile("schemas")
