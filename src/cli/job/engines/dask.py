#!/usr/bin/env python3
"""@MARK@. Dask: on this machine, or on the scheduler whose address stands behind the name of this script."""

import os
import sys

import fdm
from dask.distributed import Client

if __name__ == "__main__":
    os.chdir(@FOLDER@)
    with Client(*sys.argv[1:2]) as client:
        print(fdm.map(@PLAN@, client, shards=@SHARDS@, out=@OUT@))
