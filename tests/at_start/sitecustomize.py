"""What every Python begins with that the whole suite starts, as ``tests/__main__`` has put this folder into its path.

At its end Python looks for garbage in all that lives, so that it is finalised: a quarter of the processor time of a
process that imports numba and the mechanics, and then ends.
"""

import atexit
import gc

atexit.register(gc.freeze)
