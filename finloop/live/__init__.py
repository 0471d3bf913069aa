"""The live tank: fish that are sent by hand, its server and its page."""
