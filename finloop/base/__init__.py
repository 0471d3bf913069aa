"""What every room may use and no method is in: arrays, schemas, errors, settings, processes."""
