"""Film fish as a stimulus for animals: protocols, sessions, displays, logs."""
