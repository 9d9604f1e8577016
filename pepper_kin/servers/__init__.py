"""Servers for others over a network: who may connect, how connections begin, and how a server ends.

access             pages and clients that may connect: loopback, tokens, origins
connection_gate    connections before their first message is complete
http_server        an HTTP server behind both
end_signals        Ctrl-C and SIGTERM as a request to end
"""
