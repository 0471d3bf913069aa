"""What the live tank and a stimulus share: web server, messages, pages, and the drawing of fish."""
