"""Edit lists drawn as films and pictures."""
