"""How an agent reaches its machine: one port, one adapter per kind of machine."""
