#!/bin/sh
# Fly to a position and print how it ended: goto.sh NORTH EAST DOWN. Needs socat.
set -eu

socket=${FLIGHTD_SOCKET:-${XDG_RUNTIME_DIR:-/tmp/flightd-$(id -u)}/flightd.sock}
goal=$(printf '{"jsonrpc": "2.0", "id": 1, "method": "goal.submit", "params": {"waypoint": {"position": [%s, %s, %s]}}}' "$1" "$2" "$3")

# -t: how long socat waits for answers after the request was sent.
printf '%s\n' "$goal" | socat -t 600 - "UNIX-CONNECT:$socket" | while read -r line; do
    case $line in
    *'"error"'*)
        printf '%s\n' "$line" >&2
        exit 2
        ;;
    *'"method":"goal.result"'*)
        printf '%s\n' "$line"
        break
        ;;
    esac
done
