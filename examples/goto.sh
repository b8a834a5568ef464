#!/bin/sh
# Fly to a position and print how it ended: goto.sh NORTH EAST DOWN. Needs socat.
# Exit codes: 0 succeeded, 1 ended otherwise, 2 refused, 5 no daemon.
set -eu
[ $# -eq 3 ] || { echo "usage: goto.sh NORTH EAST DOWN" >&2; exit 2; }

socket=${FLIGHTD_SOCKET:-}
for place in /run/flightd "${XDG_RUNTIME_DIR:-/nowhere}" "/tmp/flightd-$(id -u)"; do
    if [ -z "${FLIGHTD_SOCKET:-}" ] && [ -S "$place/flightd.sock" ]; then
        [ -z "$socket" ] || { echo "sockets at $socket and $place: say which by FLIGHTD_SOCKET" >&2; exit 5; }
        socket=$place/flightd.sock
    fi
done
goal=$(printf '{"jsonrpc": "2.0", "id": 1, "method": "goal.submit", "params": {"waypoint": {"position": [%s, %s, %s]}}}' "$1" "$2" "$3")

# -t: how long socat waits for answers after the request was sent.
printf '%s\n' "$goal" | socat -t 600 - "UNIX-CONNECT:$socket" | {
    while read -r line; do
        case $line in
        *'"error"'*)
            printf '%s\n' "$line" >&2
            exit 2
            ;;
        *'"method":"goal.result"'*)
            printf '%s\n' "$line"
            case $line in *'"outcome":"succeeded"'*) exit 0 ;; esac
            exit 1
            ;;
        esac
    done
    exit 5
}
