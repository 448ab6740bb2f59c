"""Make rows.csv.gz of this folder from the files of the source that SOURCE.md names: python thinned.py <folder>.

Every twelfth row of the ramps to +-40 N m at lock positions 1, 5 and 6 is kept as it was measured.
"""

import sys
from pathlib import Path

import pandas as pd

EVERY = 12
FIRST_RAMP = 100
"""Ramps 100 to 102 go to +-40 N m, 0 to 4 to +-4 N m only."""
ARCMIN_A_TURN = 21600.0
CRANK_DEG = {1: 20.0, 5: 201.0, 6: 338.0}
"""By lock position. Not published; chosen: the middle of POSITION times the ratio 13, modulo 360 deg, as if the encoder
had kept its zero between the positions and that zero were the crank at 0."""


def thinned(path: Path, crank_deg: float) -> pd.DataFrame:
    """The rows of one lock position that are kept, in the columns of a measured unit."""
    raw = pd.read_csv(path)
    rows = raw[raw["test_nr"] >= FIRST_RAMP].iloc[::EVERY]
    return pd.DataFrame(
        {
            "cycle": rows["test_nr"] - FIRST_RAMP,
            "crank_deg": crank_deg,
            "torque_Nm": rows["TORQUE"].round(4),
            "angle_arcmin": (ARCMIN_A_TURN * rows["POSITION"]).round(3),
            "time_s": rows["TIME"].round(3),
            "command_torque_Nm": rows["CONTROL_TORQUE"].round(3),
        }
    )


def main() -> None:
    """Write rows.csv.gz beside this file."""
    source = Path(sys.argv[1])
    parts = [thinned(source / f"position{number}.csv.gz", crank) for number, crank in CRANK_DEG.items()]
    packed = {"method": "gzip", "mtime": 0}
    pd.concat(parts).to_csv(Path(__file__).parent / "rows.csv.gz", index=False, compression=packed)


if __name__ == "__main__":
    main()
