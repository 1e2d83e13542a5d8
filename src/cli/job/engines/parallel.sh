#!/usr/bin/env bash
# @MARK@. GNU parallel: @SHARDS@ shards, as many at once as there are cores; lost ones are started again.
# Several machines that see the same folder: parallel --sshlogin machine1,machine2 --workdir . ...
set -euo pipefail
cd @FOLDER@
fdm=${FDM:-fdm}
# --quote: the words of the command are no text of a shell
seq @SHARDS@ | parallel --quote --jobs "${JOBS:-100%}" --retries 100 \
    "$fdm" job run @PLAN@ --shard {}/@SHARDS@ --out @OUT@ --threads 1 --quiet
"$fdm" job merge @OUT@
