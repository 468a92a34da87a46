#!/usr/bin/env bash
# The tests as three x86-64 processors run them: of 2008 (SSE4.2), of 2013 (AVX2, fused products)
# and of 2017 (AVX-512). Sums then round otherwise, in NumPy, numba, OpenBLAS, PyTorch and the C
# library. MuJoCo has one code for all of them.
# Usage: scripts/processors.sh [ARGUMENTS OF PYTEST]; PROCESSORS="nehalem haswell" chooses some.
set -euo pipefail
cd "$(dirname "$0")/.."

old="-AVX_Fast_Unaligned_Load,-AVX2,-FMA,-FMA4,-AVX,-AVX512F,-AVX512VL,-AVX512DQ,-AVX512BW"
declare -A kept=(
    [nehalem]=""
    [haswell]="AVX F16C FMA3 AVX2 X86_V3"
    [skylake-avx512]="AVX F16C FMA3 AVX2 AVX512F AVX512CD AVX512_SKX X86_V3 X86_V4"
)
declare -A blas=([nehalem]=Nehalem [haswell]=Haswell [skylake-avx512]=SkylakeX)
declare -A torch=([nehalem]=default [haswell]=avx2 [skylake-avx512]=avx512)
declare -A libc=([nehalem]="$old" [haswell]="-AVX512F,-AVX512VL" [skylake-avx512]="-AVX512_VBMI")
declare -A needs=([nehalem]=sse4_2 [haswell]=avx2 [skylake-avx512]=avx512f)

# NumPy has had two sets of names for what it can do without, and warns of the other set's.
without() {
    .venv/bin/python - "$@" <<'EOF'
import sys
from numpy._core._multiarray_umath import __cpu_dispatch__
print(*(name for name in __cpu_dispatch__ if name not in sys.argv[1:]))
EOF
}

status=0
for processor in ${PROCESSORS:-nehalem haswell skylake-avx512}; do
    if [[ ! -v "kept[$processor]" ]]; then
        echo "processors: '$processor' is unknown; take of: ${!kept[*]}" >&2
        exit 2
    fi
    if ! grep -qw "${needs[$processor]}" /proc/cpuinfo; then
        echo "# $processor: left out, this machine has no ${needs[$processor]}"
        continue
    fi
    echo "# $processor"
    # shellcheck disable=SC2086
    NPY_DISABLE_CPU_FEATURES="$(without ${kept[$processor]})" \
        NUMBA_CPU_NAME="$processor" OPENBLAS_CORETYPE="${blas[$processor]}" \
        ATEN_CPU_CAPABILITY="${torch[$processor]}" GLIBC_TUNABLES="glibc.cpu.hwcaps=${libc[$processor]}" \
        .venv/bin/python -m pytest "$@" || status=$?
done
exit "$status"
