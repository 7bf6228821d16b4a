"""Thesis chapter 5: simulation and model-based control; its tables and figures beside the published ones.

    python experiments/chapter_5.py [--data FOLDER]

The same as ``steelyard reproduce 5 --output reproduction``.
"""

import argparse

from steelyard.reproduction import reproduce

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="reproduction")
    parser.add_argument("--data", help="folder of the real recordings")
    options = parser.parse_args()
    print(reproduce(options.output, ["5"], data=options.data, progress=print))
