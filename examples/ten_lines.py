"""From a film to a fish that swims where it is sent: `python examples/ten_lines.py [film]`."""

import sys

import finloop

film = finloop.open_film(sys.argv[1]) if sys.argv[1:] else finloop.draw_carp(frames=750)
tracks = finloop.track(film)
features = finloop.measure(tracks)
model = finloop.learn(features, film.rate_hz)
reel = finloop.make_sprites(tracks, features)
similar = finloop.compare(reel)
loops = finloop.find_loops(similar, features, film.rate_hz)
gateways = finloop.find_gateways(similar, reel)
poses = finloop.find_poses(tracks, features)
jumps = finloop.find_jumps(reel, poses)
goals = [[0.2, 0.25], [0.8, 0.7], [0.25, 0.8]]  # shares of the tank's width and height
edit = finloop.steer(tracks, reel, model, similar, loops, jumps, gateways, poses, goals=goals)
finloop.write_video("fish.mp4", edit, tracks, reel, poses)
