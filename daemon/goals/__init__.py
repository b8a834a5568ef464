"""The goal socket: protocol without I/O, mailbox, server, client."""
