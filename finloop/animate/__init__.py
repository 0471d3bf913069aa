"""What all playing modes share: tank, motion of the film, fish, routes, measures."""
