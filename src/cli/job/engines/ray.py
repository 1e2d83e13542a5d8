#!/usr/bin/env python3
"""@MARK@. Ray: on this machine, or on the cluster whose address stands behind the name of this script."""

import os
import sys

import fdm
import ray

if __name__ == "__main__":
    os.chdir(@FOLDER@)
    ray.init(*sys.argv[1:2])
    print(fdm.map(@PLAN@, ray, shards=@SHARDS@, out=@OUT@))
