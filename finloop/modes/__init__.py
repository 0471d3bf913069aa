"""The playing modes: network, loops and hybrid of the fish paper, and matching."""
