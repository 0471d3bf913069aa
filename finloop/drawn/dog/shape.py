"""The parts of the drawn dog, standing, and how its limbs bend: outlines, joints, skin.

Unit: the trunk, from hip to shoulder joint, is 1 long. x is forward (screen right), y down, 0 at
the ground below the middle of the trunk. Outlines run clockwise as seen.

A limb has four bones, each turning about its upper joint: upper, lower, pastern and paw. Its skin
moves by linear blend skinning: a bone weighs the more, the nearer to the point it lies at rest.
"""
