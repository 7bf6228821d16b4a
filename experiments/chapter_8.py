"""Thesis section 8.1, which it leaves open: what impossible parameters do beyond the inertia matrix.

    python experiments/chapter_8.py [--data FOLDER]

The same as ``steelyard reproduce 8 --output reproduction``.
"""

import argparse

from steelyard.reproduction import reproduce

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="reproduction")
    parser.add_argument("--data", help="folder of the real recordings")
    options = parser.parse_args()
    print(reproduce(options.output, ["8"], data=options.data, progress=print))
