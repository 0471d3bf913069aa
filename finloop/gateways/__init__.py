"""Gateways between sprites and film (fish paper §4.2-4.3)."""
