"""The whole scheduling site in one process and in virtual time, on a bus that loses, doubles, delays and cuts.

The scheduler's shell, engine, core, policy and journal and the agents' shell, core and journal are the real ones; what
is simulated is the clock, the bus, the machines, the operator and the trouble. One seed gives one run, exactly.
"""
