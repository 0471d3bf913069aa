"""What is measured of each fish in each frame (fish paper §2.2-2.3)."""
