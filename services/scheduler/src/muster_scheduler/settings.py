"""What the scheduler reads from its environment, once."""

from muster_bus.settings import ServiceSettings
from pydantic import SecretStr, field_validator


class SchedulerSettings(ServiceSettings):
    """Beside the site, router and log: where the journal lies."""

    database_url: SecretStr | None = None
    """`postgresql://user:password@host/database`; None: SQLite in the data directory."""

    @field_validator("database_url")
    @classmethod
    def _postgresql(cls, url: SecretStr | None) -> SecretStr | None:
        if url is not None and not url.get_secret_value():
            return None  # as compose.yaml leaves it
        if url is not None and not url.get_secret_value().startswith(("postgresql://", "postgres://")):
            raise ValueError("must begin with postgresql://; leave it out for SQLite in MUSTER_DATA_DIR")
        return url

    def environment(self) -> dict[str, str]:
        """Return the variables with which another process finds the same journal."""
        url = self.database_url
        return {
            "MUSTER_SITE_FILE": str(self.site_file.resolve()),
            "MUSTER_DATA_DIR": str(self.data_dir.resolve()),
            **({"MUSTER_DATABASE_URL": url.get_secret_value()} if url else {}),
        }
