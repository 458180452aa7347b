"""How a project runs: DVC's files and locks, signals, memory, telemetry, text on a terminal."""
