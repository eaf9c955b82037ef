#!/usr/bin/env bash
# Runs a command where two virtual SocketCAN interfaces, vcan0 and vcan1, are up and belong to it alone.
#
#   scripts/with_vcan.sh 'candump -n 1 vcan0 & sleep 1; cansend vcan0 123#11; wait'
#
# Where this kernel has SocketCAN, that is a network namespace. Where it has none, a Debian kernel boots in qemu with this
# machine's file system, read-only but for $TMPDIR; that is some 25 times slower. The second way needs root and apt on
# Debian (x86-64), and keeps an unpacked kernel in ~/.cache/canarm-vcan.
#
# Exit status: the command's. Where there is neither way: 0 and a line that begins with "skipped", in CI 1.
#   VCAN_LIMIT=600   seconds after which the machine in qemu is switched off; status 124
set -euo pipefail

say() { echo "with_vcan: $*" >&2; }

skip() {
    echo "skipped (with_vcan): $*"
    [[ -z ${CI:-} ]] || exit 1
    exit 0
}

if (($# == 0)); then
    sed -n '2,/^set /s/^# \{0,1\}//p' "$0"
    exit 2
fi

# In a namespace.

bring_up='for interface in vcan0 vcan1; do ip link add "$interface" type vcan && ip link set "$interface" up || exit 1; done
ip link set lo up'
[[ $(id -u) == 0 ]] && namespace=(unshare --net) || namespace=(unshare --user --map-root-user --net)
if "${namespace[@]}" bash -c "$bring_up" >/dev/null 2>&1; then
    exec "${namespace[@]}" bash -c "$bring_up; $*"
fi

# In a machine of its own.

cache=${XDG_CACHE_HOME:-$HOME/.cache}/canarm-vcan

install_programs() {
    local missing=()
    command -v qemu-system-x86_64 >/dev/null || missing+=(qemu-system-x86)
    command -v modprobe >/dev/null || missing+=(kmod)
    command -v candump >/dev/null || missing+=(can-utils)
    command -v xz >/dev/null || missing+=(xz-utils)
    [[ -x /bin/busybox ]] && ! ldd /bin/busybox >/dev/null 2>&1 || missing+=(busybox-static)
    ((${#missing[@]})) || return 0
    say "installing ${missing[*]}"
    export DEBIAN_FRONTEND=noninteractive
    apt-get -qq -o Acquire::Retries=3 update >&2 &&
        apt-get -qq -o Acquire::Retries=3 -o DPkg::Lock::Timeout=300 install -y --no-install-recommends "${missing[@]}" >&2
}

# Only what the machine loads, so that the cache stays small; modules plain, since busybox loads them.
unpack_kernel() {
    [[ ! -e $cache/boot ]] || return 0
    say "fetching a kernel into $cache"
    local fresh image
    fresh=$(mktemp -d)
    image=$(kernel_package) || { apt-get -qq update >&2 && image=$(kernel_package); } || return 1
    (cd "$fresh" && apt-get -qq -o Acquire::Retries=3 -o APT::Sandbox::User=root download "$image") || return 1
    dpkg-deb --fsys-tarfile "$fresh"/*.deb | tar -x -C "$fresh" --wildcards './boot/vmlinuz*' '*/modules.builtin*' \
        '*/modules.order' '*/kernel/net/9p/*' '*/kernel/net/can/*' '*/kernel/fs/*' '*/kernel/drivers/virtio/*' \
        '*/kernel/drivers/net/can/*' || return 1
    rm "$fresh"/*.deb
    [[ -d $fresh/lib ]] || ln -s usr/lib "$fresh/lib"
    find "$fresh" -name '*.ko.xz' -exec xz -d {} +
    depmod -b "$fresh" "$(ls "$fresh/lib/modules")" || return 1
    mkdir -p "$(dirname "$cache")"
    mv "$fresh" "$cache"
}

kernel_package() { apt-cache depends linux-image-amd64 2>/dev/null | grep -o 'linux-image-[0-9][^ ]*' | head -n 1 | grep .; }

# An initial file system: busybox, the modules, and two scripts, one for the machine and one with the command.
pack_initial() {
    local initial=$1 command_line=$2 version modules
    version=$(ls "$cache/lib/modules")
    mkdir -p "$initial"/{bin,modules,host}
    cp /bin/busybox "$initial/bin/"
    modules=$(for name in virtio_pci 9pnet_virtio 9p can-raw vcan; do
        modprobe --dirname "$cache" --set-version "$version" --show-depends "$name" || exit
    done) || return 1
    # Each once, in the order in which they are needed.
    awk '/^insmod/ && !done[$2]++ { print $2 }' <<<"$modules" | cat -n | while read -r number path; do
        cp "$path" "$initial/modules/$(printf %03d "$number").ko"
    done
    cat >"$initial/init" <<'INIT'
#!/bin/busybox sh
PATH=/bin
/bin/busybox --install -s /bin
for module in /modules/*; do insmod "$module"; done
mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000,cache=loose,ro host /host
mount -t proc proc /host/proc
mount -t sysfs sys /host/sys
mount -t devtmpfs dev /host/dev
mkdir -p /host/dev/shm /host/dev/pts
mount -t tmpfs shm /host/dev/shm
mount -t devpts pts /host/dev/pts
mkdir /host/dev/shm/tmp
cp /command /host/dev/shm/command
for interface in vcan0 vcan1; do ip link add "$interface" type vcan; ip link set "$interface" up; done
ip link set lo up
stty -onlcr </host/dev/ttyS0
chroot /host /bin/bash /dev/shm/command </host/dev/null >/host/dev/ttyS0 2>&1
echo $? >/host/dev/ttyS1
poweroff -f
INIT
    chmod +x "$initial/init"
    {
        printf 'export PATH=%q HOME=%q TMPDIR=/dev/shm/tmp TERM=dumb LANG=C.UTF-8 PYTHONDONTWRITEBYTECODE=1\n' "$PATH" "$HOME"
        [[ -z ${CI:-} ]] || printf 'export CI=%q\n' "$CI"
        printf 'cd %q\n%s\n' "$PWD" "$command_line"
    } >"$initial/command"
}

[[ $(uname -sm) == "Linux x86_64" ]] || skip "this kernel has no SocketCAN, and the way around that needs Linux on x86-64"
[[ $(id -u) == 0 ]] || skip "this kernel has no SocketCAN, and the way around that needs root"
command -v apt-get >/dev/null || skip "this kernel has no SocketCAN, and the way around that needs apt-get"
install_programs || skip "apt-get could not install what is needed"
unpack_kernel || skip "apt-get could not fetch a kernel"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
pack_initial "$work/initial" "$*" || skip "the kernel in $cache lacks a module; remove that folder"
(cd "$work/initial" && find . | busybox cpio -o -H newc 2>/dev/null | gzip -1) >"$work/initial.gz"
: >"$work/status"
result=0
timeout --foreground "${VCAN_LIMIT:-600}" qemu-system-x86_64 -accel tcg,thread=multi -cpu max -smp 2 -m 3072 \
    -nodefaults -display none -no-reboot -serial stdio -serial "file:$work/status" \
    -kernel "$cache"/boot/vmlinuz* -initrd "$work/initial.gz" -append "console=ttyS0 quiet loglevel=3 panic=-1" \
    -virtfs local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap </dev/null || result=$?
status=$(tr -cd 0-9 <"$work/status")
[[ -n $status ]] && exit "$status"
say "the machine in qemu ended without a status (qemu: $result)"
exit "$((result == 0 ? 1 : result))"
