"""What happens to files on bad disks and in crashes."""

import random


def damaged(content, seed):
    """The content with one flipped bit, or with a block of zeros, always another than before."""
    chance = random.Random(seed)
    result = bytearray(content)
    while result == content:
        at = chance.randrange(len(result))
        if seed % 2:
            end = min(at + 512, len(result))
            result[at:end] = bytes(end - at)
        else:
            result[at] ^= 1 << chance.randrange(8)
    return bytes(result)
