"""Pictures of the drawn dog, and the regions of its limbs in them.

Flat colours on a meadow that passes by. The near limbs are paler than everything else, so that
`limb_masks` can segment them by their colour; the far limbs are partly hidden.
"""
