#!/usr/bin/env bash
# Run the acceptance test of the live camera in a machine of its own: QEMU without KVM, Debian's kernel, vhci_hcd.
#
#     tests/hardware/run_qemu.sh [COMMAND...]      by default: python tests/hardware/acceptance.py
#
# The guest sees this machine's files, read-only, and uses the Python that is active here. Where something is missing
# it says what, and exits with 77 ("skipped").
set -euo pipefail
cd "$(dirname "$0")/../.."

skip() {
    printf '\n*** SKIPPED: the live camera was NOT tested: %s\n\n' "$*" >&2
    exit 77
}

command -v qemu-system-x86_64 >/dev/null || skip "qemu-system-x86_64 is missing (Debian: apt-get install qemu-system-x86)"
busybox=$(command -v busybox) || skip "busybox is missing (Debian: apt-get install busybox-static)"
if ldd "$busybox" >/dev/null 2>&1; then skip "busybox is not static (Debian: apt-get install busybox-static)"; fi
command -v cpio >/dev/null || skip "cpio is missing (Debian: apt-get install cpio)"
kernel=$(find /boot -name 'vmlinuz-*-amd64' 2>/dev/null | sort -V | tail -n 1)
[ -n "$kernel" ] || skip "there is no Debian kernel in /boot (apt-get install linux-image-amd64)"
release=${kernel#/boot/vmlinuz-}
python=$(command -v python) || skip "there is no python in PATH (activate the environment with davis_rs)"
"$python" -c 'import davis_rs, usb.core, usb.backend.libusb1 as b; assert b.get_backend()' 2>/dev/null ||
    skip "$python lacks davis_rs, pyusb or libusb 1.0 (Debian: apt-get install libusb-1.0-0)"

root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
mkdir -p "$root/bin" "$root/modules"
cp "$busybox" "$root/bin/busybox"
cp tests/hardware/init "$root/init"
# Modules with what they need, each after its own needs.
for module in virtio_pci 9p 9pnet_virtio vhci-hcd; do
    /sbin/modprobe --set-version "$release" --show-depends --ignore-install "$module" || skip "no module $module for $release"
done | awk '$1 == "insmod" && !seen[$2]++ { print $2 }' | while read -r file; do
    cp "$file" "$root/modules/"
    basename "$file" >> "$root/modules/order"
done
[ $# -gt 0 ] || set -- "$python" tests/hardware/acceptance.py
printf 'cd %q; export TMPDIR=/run PYTHONDONTWRITEBYTECODE=1; exec timeout 600 %s\n' "$PWD" "$(printf '%q ' "$@")" > "$root/command"
(cd "$root" && find . | cpio --quiet -o -H newc | gzip -1) > "$root.img"
trap 'rm -rf "$root" "$root.img"' EXIT

output=$(mktemp)
trap 'rm -rf "$root" "$root.img" "$output"' EXIT
start=$(date +%s)
timeout 720 qemu-system-x86_64 -machine q35,accel=tcg -cpu max -m 1024 -smp 2 -nographic -no-reboot -nic none \
    -kernel "$kernel" -initrd "$root.img" -append "console=ttyS0 quiet panic=-1 mitigations=off" \
    -virtfs local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap </dev/null | tee "$output"
echo "the machine ran for $(($(date +%s) - start)) s"
grep -q 'guest: exit status 0' "$output"
