// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Reads from an OpenIGTLink server with the reference library, every CRC checked:
// igtl_client PORT MESSAGES. A line a message: type, device, and its numbers.
#include <igtlClientSocket.h>
#include <igtlMessageHeader.h>
#include <igtlPolyDataMessage.h>
#include <igtlSensorMessage.h>
#include <igtlStatusMessage.h>
#include <igtlTransformMessage.h>

#include <cstdio>
#include <cstdlib>
#include <string>

namespace {

template <class Message>
typename Message::Pointer received(igtl::ClientSocket* socket, igtl::MessageHeader* header) {
    auto message = Message::New();
    message->SetMessageHeader(header);
    message->AllocatePack();
    bool timeout = false;
    socket->Receive(message->GetPackBodyPointer(), message->GetPackBodySize(), timeout);
    if ((message->Unpack(1) & igtl::MessageHeader::UNPACK_BODY) == 0) {
        std::puts("BAD CRC");
        std::exit(1);
    }
    return message;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 3) return 2;
    auto socket = igtl::ClientSocket::New();
    if (socket->ConnectToServer("127.0.0.1", std::atoi(argv[1])) != 0) return 1;
    for (int k = 0; k < std::atoi(argv[2]); ++k) {
        auto header = igtl::MessageHeader::New();
        header->InitPack();
        bool timeout = false;
        if (socket->Receive(header->GetPackPointer(), header->GetPackSize(), timeout) == 0)
            return 1;
        header->Unpack();
        const std::string type = header->GetDeviceType();
        std::printf("%s %s", type.c_str(), header->GetDeviceName());
        if (type == "TRANSFORM") {
            igtl::Matrix4x4 m;
            received<igtl::TransformMessage>(socket, header)->GetMatrix(m);
            std::printf(" %.9g %.9g %.9g", double(m[0][3]), double(m[1][3]), double(m[2][3]));
        } else if (type == "SENSOR") {
            auto sensor = received<igtl::SensorMessage>(socket, header);
            for (unsigned i = 0; i < sensor->GetLength(); ++i)
                std::printf(" %.17g", sensor->GetValue(i));
        } else if (type == "STATUS") {
            auto status = received<igtl::StatusMessage>(socket, header);
            std::printf(" %d %s", status->GetCode(), status->GetStatusString());
        } else {
            auto data = received<igtl::PolyDataMessage>(socket, header);
            std::printf(" %d points", data->GetPoints()->GetNumberOfPoints());
            igtlFloat32 p[3];
            data->GetPoints()->GetPoint(0, p);
            std::printf(" %.9g %.9g %.9g", double(p[0]), double(p[1]), double(p[2]));
            std::printf(" %d lines %d polygons", data->GetLines()->GetNumberOfCells(),
                        data->GetPolygons()->GetNumberOfCells());
        }
        std::printf("\n");
        std::fflush(stdout);
    }
}
