"""A film of a drawn dog that walks, with the truth about every limb (curve paper §4.2, Fig. 9)."""
