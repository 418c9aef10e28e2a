"""Connections of the emulator, without its robot."""

import socket
import time

from drivers.ur.emulator.server import LineDialogue, Server


def test_connection_closed_by_the_handler_before_it_is_not_served_again():
    server, handled = Server(), []

    def reply(port, line):
        handled.append(line)
        server.drop_links(port)
        return ""

    ports = [0, 0]
    for i in range(2):
        ports[i] = server.listen(
            "127.0.0.1", 0, lambda i=i: (LineDialogue(lambda line: reply(ports[i], line)), b"")
        )
    clients = [socket.create_connection(("127.0.0.1", port)) for port in ports]
    try:
        server.serve(time.monotonic_ns())
        for client in clients:
            client.sendall(b"drop the others\n")
        server.serve(time.monotonic_ns())
    finally:
        for client in clients:
            client.close()
        server.close()
    assert handled == ["drop the others"]
