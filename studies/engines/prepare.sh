#!/usr/bin/env bash
# Engines in a folder of their own, without containers and without installing anything: wheels into a virtual environment, packages of
# Debian 12 unpacked. Needs the package indexes of Python and Debian.
set -euo pipefail
place=${FDM_ENGINES:-target/engines}
mkdir -p "$place/packages" "$place/root"
cd "$place"
[ -x venv/bin/python ] || python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check dask distributed ray hyperqueue mpi4py numpy
cd packages
apt-get install --yes --no-install-recommends --print-uris slurmctld slurmd slurm-client parallel openmpi-bin munge |
    sed -n "s/^'\([^']*\)'.*/\1/p" | sed 's/.*\///; s/_.*//' | sort -u | xargs apt-get download --quiet
cd ..
for package in packages/*.deb; do dpkg -x "$package" root; done
# as the system's alternatives would name them
for name in slurmctld slurmd slurmstepd; do ln -sf "$name-wlm" "root/usr/sbin/$name"; done
ln -sf orterun root/usr/bin/mpirun
