#!/bin/sh
# Makes an authority (ca.pem) and a certificate for each of the two machines, in the working folder. They expire after a year.
#     certificates.sh
set -eu
openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 365 -subj "/CN=modulo authority" \
    -keyout ca.key -out ca.pem
for machine in camera perception; do
    openssl req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj "/CN=$machine" -keyout "$machine.key" -out "$machine.csr"
    printf 'subjectAltName=DNS:%s\n' "$machine" |
        openssl x509 -req -in "$machine.csr" -CA ca.pem -CAkey ca.key -CAcreateserial -days 365 -extfile /dev/stdin \
            -out "$machine.pem"
    rm "$machine.csr"
done
