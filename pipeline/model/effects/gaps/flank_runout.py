"""Run-out of the disk's flank against its bore."""

import numpy as np

from pipeline.model.effects.gaps._runout import runout

EFFECT = runout(
    "flank_runout",
    "run-out of the flank, or of the disk's bore",
    lambda drive, x, y: drive.with_added_errors(bore_runout=np.array([x, y])),
    "offset of the flank's centre from that of the bore, towards the first lobe's valley",
    physics="the centre of the lobes lies off the bore: as a run-out of the pin circle, in a frame that turns "
    "with the disk, and so of order N/Z of the crank",
    changes="place of the flank on the disk",
    told_apart_by="positions a quarter of an output turn apart",
    signature="as that of the pin circle, but its phase moves by a quarter as the output turns by a quarter",
)
